"""Rules for the ZIP archive of an FMU and its content (FMI 2.0.4, section 2.3)."""

from __future__ import annotations

import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from ..cosim.library import MODULE_FILE, find_missing
from ..files.archive import read_member
from .reading import Description

_DATA_DESCRIPTOR = 1 << 3  # general purpose bit 3
_VERSION = 20  # 2.0
_MOST_BYTES = 2**20  # of a text of one line


def find_problems(path: Path, description: Description) -> list[str]:
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
