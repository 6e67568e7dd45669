"""Rules for ModelStructure: which variables are listed, in which order, on what they depend; and for the archive."""

from __future__ import annotations

import zipfile
from collections import Counter
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path, PurePosixPath

from ..cosim.library import MODULE_FILE, find_missing
from ..files.archive import read_member
from .reading import Description, Faults, Unknown, Variable, parse_index
from .variable_rules import find_initial

_PARTS = ("Outputs", "Derivatives", "InitialUnknowns")
_KINDS = ("dependent", "constant", "fixed", "tunable", "discrete")
_INITIAL_KINDS = ("dependent", "constant")


def check_outputs(description: Description) -> Faults:
    """Outputs lists every output once, and nothing else."""
    wanted = [v for v in description.variables if v.causality == "output"]
    yield from _compare_list(description, "Outputs", wanted)


def check_derivatives(description: Description) -> Faults:
    """Derivatives lists variables that are derivatives."""
    for unknown in description.unknowns("Derivatives"):
        variable = description.variable(unknown.index)
        if variable is None or "derivative" not in variable.attributes:
            yield unknown.line, f"Derivatives: index {unknown.index} is not a variable with the attribute derivative"


def check_initial_unknowns(description: Description) -> Faults:
    """InitialUnknowns lists outputs, states and derivatives that are not exact, and all calculated parameters."""
    dynamic = set()
    for unknown in description.unknowns("Derivatives"):
        variable = description.variable(unknown.index)
        if variable is not None:
            dynamic |= {variable.index, parse_index(variable.attributes.get("derivative"))}
    wanted = [
        v
        for v in description.variables
        if v.causality == "calculatedParameter"
        or ((v.causality == "output" or v.index in dynamic) and find_initial(v) in ("approx", "calculated"))
    ]
    yield from _compare_list(description, "InitialUnknowns", wanted)


def check_initial_order(description: Description) -> Faults:
    """InitialUnknowns ascends by index."""
    for first, second in pairwise(description.unknowns("InitialUnknowns")):
        if first.index > second.index:
            yield second.line, f"InitialUnknowns: index {second.index} comes after {first.index}, expected ascending"


def check_dependencies(description: Description) -> Faults:
    """Dependencies are indices of variables."""
    for part, unknown in _list_unknowns(description):
        for index in unknown.dependencies or ():
            if description.variable(index) is None:
                yield unknown.line, f"{part}: {_name(description, unknown)} depends on {index}, which is not an index"


def check_known(description: Description) -> Faults:
    """Unknowns depend on knowns: inputs, time, and states or, in InitialUnknowns, variables with initial="exact"."""
    states = {parse_index(v.attributes.get("derivative")) for v in description.variables}
    for part, unknown in _list_unknowns(description):
        for index in unknown.dependencies or ():
            known = description.variable(index)
            if known is not None and not _is_known(known, part, states):
                expected = 'variables with initial="exact"' if part == "InitialUnknowns" else "continuous-time states"
                yield unknown.line, (
                    f"{part}: {_name(description, unknown)} depends on {known.name} ({known.causality}); "
                    f"there only inputs, the independent variable and {expected} are knowns"
                )


def check_dependencies_order(description: Description) -> Faults:
    """Dependencies ascend by index."""
    for part, unknown in _list_unknowns(description):
        if any(first >= second for first, second in pairwise(unknown.dependencies or ())):
            yield unknown.line, f"{part}: the dependencies of {_name(description, unknown)} do not ascend"


def check_dependencies_kind(description: Description) -> Faults:
    """dependenciesKind has one word of the standard for each dependency."""
    for part, unknown in _list_unknowns(description):
        if unknown.kinds is None:
            continue
        name = f"{part}: {_name(description, unknown)}"
        if unknown.dependencies is None or len(unknown.kinds) != len(unknown.dependencies):
            count = len(unknown.dependencies or ())
            yield unknown.line, f"{name} states {len(unknown.kinds)} dependenciesKind for {count} dependencies"
        for kind in sorted(set(unknown.kinds) - set(_KINDS)):
            yield unknown.line, f"{name}: dependenciesKind {kind!r} is unknown, expected {', '.join(_KINDS)}"


def check_factors(description: Description) -> Faults:
    """Only a Real depends by a factor; in InitialUnknowns that is constant."""
    for part, unknown in _list_unknowns(description):
        variable, kinds = description.variable(unknown.index), set(unknown.kinds or ()) & set(_KINDS)
        name = f"{part}: {_name(description, unknown)}"
        for kind in sorted(kinds - {"dependent"}):
            if variable is not None and variable.type != "Real":
                reason = f"only a Real depends by a factor, this is of type {variable.type}: expected 'dependent'"
                yield unknown.line, f"{name}: dependenciesKind {kind!r} is not allowed: {reason}"
            elif part == "InitialUnknowns" and kind not in _INITIAL_KINDS:
                reason = f"expected {' or '.join(map(repr, _INITIAL_KINDS))} in InitialUnknowns"
                yield unknown.line, f"{name}: dependenciesKind {kind!r} is not allowed: {reason}"


def _list_unknowns(description: Description) -> Iterator[tuple[str, Unknown]]:
    """The unknowns of all parts, each with the name of its part."""
    for part in _PARTS:
        for unknown in description.unknowns(part):
            yield part, unknown


def _name(description: Description, unknown: Unknown) -> str:
    variable = description.variable(unknown.index)
    return f"unknown {unknown.index}" + (f" ({variable.name})" if variable is not None else "")


def _is_known(variable: Variable, part: str, states: set[int]) -> bool:
    if variable.causality in ("input", "independent"):
        return True
    if part == "InitialUnknowns":
        return find_initial(variable) == "exact"
    return variable.index in states


def _compare_list(description: Description, part: str, wanted: list[Variable]) -> Faults:
    structure = description.root.find("ModelStructure")
    line = structure.line if structure is not None else description.root.line
    listed = Counter(unknown.index for unknown in description.unknowns(part))
    for variable in wanted:
        if variable.index not in listed:
            yield line, f"{part}: {variable.name} (index {variable.index}) is missing"
    allowed = {variable.index for variable in wanted}
    for unknown in description.unknowns(part):
        variable_there = description.variable(unknown.index)
        name = variable_there.name if variable_there is not None else "no variable"
        if unknown.index not in allowed:
            yield unknown.line, f"{part}: index {unknown.index} ({name}) does not belong here"
        elif listed[unknown.index] > 1:
            yield unknown.line, f"{part}: {name} (index {unknown.index}) is listed more than once"


# --- The ZIP archive of an FMU and its content (FMI 2.0.4, section 2.3) -----------------------------------------------

_DATA_DESCRIPTOR = 1 << 3  # general purpose bit 3
_VERSION = 20  # 2.0
_MOST_BYTES = 2**20  # of a text of one line


def find_archive_problems(path: Path, description: Description) -> list[str]:
    """The problems of an archive that is safe to unpack."""
    with zipfile.ZipFile(path) as archive:
        members = archive.infolist()
    names = [member.filename for member in members]
    return [
        *_check_suffix(path), *_check_members(members), *_compare_names(names), *_check_content(names, description),
        *_check_pythonfmu(path, names, description),
    ]  # fmt: skip


def _check_suffix(path: Path) -> Iterator[str]:
    if path.suffix != ".fmu":
        yield f"the file is named {path.name}, expected a name that ends with .fmu"


def _check_members(members: list[zipfile.ZipInfo]) -> Iterator[str]:
    for member in members:
        method, name = member.compress_type, member.filename
        if method not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
            yield f"{name}: compression method {method}, expected 8 (deflate) or 0 (store)"
        elif method == zipfile.ZIP_STORED and member.flag_bits & _DATA_DESCRIPTOR and member.file_size:
            yield f"{name}: stored with its size behind it (general purpose bit 3), allowed only with deflate"
        if member.extract_version > _VERSION:
            yield f"{name}: version {member.extract_version / 10:g} is needed to extract, expected 2.0 at most"


def _compare_names(names: list[str]) -> Iterator[str]:
    folded: dict[str, str] = {}
    for name in names:
        other = folded.setdefault(name.lower(), name)
        if other != name:
            yield f"{other} and {name} are one file where case does not matter"


def _check_pythonfmu(path: Path, names: list[str], description: Description) -> Iterator[str]:
    if description.root.attributes.get("generationTool", "").startswith("PythonFMU"):
        named = MODULE_FILE in names
        content = read_member(path, MODULE_FILE, _MOST_BYTES) if named else None
        if problem := find_missing(content, names):
            yield f"{problem}: pythonfmu's library crashes without it"


def _check_content(names: list[str], description: Description) -> Iterator[str]:
    """There are libraries with the right name, or sources; of sources all that are listed."""
    paths = {PurePosixPath(name) for name in names}
    with_sources = any(path.parts[0] == "sources" for path in paths)
    for child in description.root.children:
        if child.tag not in ("CoSimulation", "ModelExchange"):
            continue
        identifier = child.attributes.get("modelIdentifier", "")
        libraries = [p for p in paths if len(p.parts) == 3 and p.parts[0] == "binaries" and p.stem == identifier]
        if not libraries and not with_sources:
            yield f"there is neither a library binaries/<platform>/{identifier}.* nor a folder sources"
        listed = child.find("SourceFiles")
        for file in listed.all("File") if listed is not None else ():
            name = file.attributes.get("name", "")
            if with_sources and PurePosixPath("sources", name) not in paths:
                yield f"{child.tag} lists the source file {name}, there is no sources/{name}"
