"""The launcher in front of an FMU that pythonfmu's own builder made: ``ps-fmu wrap``.

The author's files stay as they are.  What is added: the launcher, a script that loads the slave with modules of its
own and a border to the library (:mod:`..author.pythonfmu_slave`), and on demand a Python.  The model description
claims what a trial run has confirmed, and gets what validators miss in pythonfmu's.
"""

from __future__ import annotations

import os
import re
import tempfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element, SubElement, tostring

import pythonfmu

from ... import __version__
from ..author.model_description import make_guid
from . import licenses, smoke
from . import zip_writer as archive
from .bundle import BundleError, bundle
from .bundle import check as check_bundle
from .dependencies import write_external_dependencies
from .entry import write_loading_entry
from .errors import BuildError
from .files import write_atomically
from .launch import OLDEST_PYTHON, put_launcher_in_front, write_notes
from .licenses import LicenseError
from .modules import pack_modules
from .sources import Files, SourceError, collect_imported, find_needed_modules
from .stock import DESCRIPTION, RESOURCES, Stock, StockError, read_stock

PACKAGE = Path(__file__).resolve().parents[2]
_KIT = ("ps_fmu.slavekit.author.pythonfmu_slave",)
_STATE, _BYTES = "canGetAndSetFMUstate", "canSerializeFMUstate"
_COMPILED = (".so", ".pyd", ".dylib", ".dll")
_REQUIREMENT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_ELSEWHERE = re.compile(r"""platform\w*\s*==\s*["'](win32|cygwin|Windows|darwin|Darwin)""")


def name_package(sources: Files) -> str:
    """The name that ``ps_fmu`` has in FMUs which share these of its files: they load each module once in a process."""
    return f"ps_fmu_{archive.compute_digest(sources).hex()[:12]}"


def wrap(
    fmu: Path, output: Path, *, interpreter: Path | None = None, bundled: bool = False, source: Path | None = None
) -> tuple[Path, list[str]]:
    """Put the launcher in front of an FMU, run the result for a few steps and write it.

    Parameters
    ----------
    fmu: made by pythonfmu 0.7.  Its code is run, in a process of its own, with the rights of the user.
    output: the new file, which ends with .fmu, or a folder, in which it is called ``<model>.fmu``.
    interpreter: noted in the FMU as the Python for hosts that do not run one.
    bundled: put this Python into the FMU, with the packages that the slave imports or its requirements.txt names.
    source: the script that ``fmu`` has just been built from; messages name it.  The result then states no date: the
        same source gives the same bytes, in Python of one minor version.

    Returns
    -------
    tuple: path of the new file; remarks, a line each, on claims that were taken back.

    Raises
    ------
    BuildError: ``fmu`` is not such an FMU, or does not run.
    """
    check_interpreter(interpreter)
    try:
        stock = read_stock(fmu)
        if source is not None:
            stock.description.attrib.pop("generationDateAndTime", None)
        is_file = output.suffix == ".fmu" and not output.is_dir()
        target = output if is_file else output / f"{stock.model}.fmu"
        content, remarks = _try_claims(stock, interpreter, bundled)
    except (StockError, SourceError, BundleError, LicenseError, smoke.SmokeError) as error:
        raise BuildError(f"{source or fmu}: {error}") from None
    target.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(target, content)
    return target, remarks


def check_interpreter(interpreter: Path | None) -> None:
    """Raise BuildError if this is not a program."""
    if interpreter is not None and not (interpreter.is_file() and os.access(interpreter, os.X_OK)):
        raise BuildError(f"--interpreter: {interpreter} is no program: expected the path of a Python")


def _try_claims(stock: Stock, interpreter: Path | None, bundled: bool) -> tuple[bytes, list[str]]:
    """The FMU with the most claims of its author that the trial run confirms, and what was taken back."""
    remarks: list[str] = []
    interface = stock.description.find("CoSimulation")
    assert interface is not None
    with tempfile.TemporaryDirectory(prefix="ps_fmu_wrap_") as folder:
        trial = Path(folder) / f"{stock.model}.fmu"
        while True:  # each round takes a claim back
            archive.write(trial, _add_launcher(stock, interpreter))
            try:
                smoke.check(trial)
                break
            except smoke.StateError as error:
                claim = _BYTES if interface.get(_BYTES) == "true" else _STATE
                interface.set(claim, "false")
                remarks.append(f"{claim} is taken back: {error}")
        if bundled:
            archive.write(trial, _add_launcher(stock, interpreter, bundled=True))
            check_bundle(trial)
        return trial.read_bytes(), remarks


def _add_launcher(stock: Stock, interpreter: Path | None, bundled: bool = False) -> Files:
    """All files of the new FMU."""
    files = dict(stock.files)
    if RESOURCES / "pythonfmu" / "fmi2slave.py" not in files:
        own = Path(pythonfmu.__file__).parent
        files |= {RESOURCES / "pythonfmu" / path.name: path.read_bytes() for path in own.glob("*.py")}
    inside = {name.relative_to(RESOURCES): content for name, content in files.items() if name.parts[0] == "resources"}
    modules = find_needed_modules(stock.script, inside)
    kit = collect_imported(_KIT, {"ps_fmu": PACKAGE})
    _complete(stock.description, bundled)
    stock.description.set("guid", "")
    files[DESCRIPTION] = tostring(stock.description)
    digest = archive.compute_digest(files | kit)

    package = name_package(kit)
    archived, packed = pack_modules(package, {name.relative_to("ps_fmu"): content for name, content in kit.items()})
    files |= {RESOURCES / package / name: content for name, content in packed.items()}
    entry, private = f"{stock.script}_{digest.hex()[:12]}", f"fmu_{digest.hex()[:12]}"
    names = sorted(_find_private_names(inside))
    files[RESOURCES / f"{entry}.py"] = write_loading_entry(package, archived, private, stock.script, names)
    files[RESOURCES / "slavemodule.txt"] = entry.encode()
    guid = make_guid(digest)
    stock.description.set("guid", guid)
    files[DESCRIPTION] = tostring(stock.description, encoding="UTF-8", xml_declaration=True) + b"\n"
    files |= put_launcher_in_front(files, stock.model)
    files[RESOURCES / "launcher.txt"] = write_notes(guid, modules, interpreter)
    dependencies = write_external_dependencies(stock.model, OLDEST_PYTHON, modules, bundled)
    files.setdefault(PurePosixPath("documentation", "externalDependencies.txt"), dependencies)
    texts = list(licenses.collect_source_licenses({}))
    if bundled:
        runtime = bundle(modules, _find_requirements(inside))
        texts += runtime.licenses
        files |= {PurePosixPath("binaries/linux64") / name: content for name, content in runtime.files.items()}
    return files | licenses.write_licenses(texts, "launcher")


def _find_private_names(files: Files) -> Iterator[str]:
    """Modules and packages of Python source.  Those with compiled parts can be loaded once in a process only."""
    compiled = {name.parts[0] for name in files if name.name.endswith(_COMPILED)}
    for name in {name.parts[0] for name in files if name.suffix == ".py"} - compiled:
        if name.removesuffix(".py").isidentifier():
            yield name.removesuffix(".py")


def _find_requirements(files: Files) -> list[str]:
    """The distributions that requirements.txt names for Linux, where bundles are; pythonfmu itself is in the FMU."""
    text = files.get(PurePosixPath("requirements.txt"), b"").decode(errors="replace")
    found = [_REQUIREMENT.match(line.strip()) for line in text.splitlines() if not _ELSEWHERE.search(line)]
    return [name[0] for name in found if name is not None and name[0].lower() != "pythonfmu"]


def _complete(description: Element, bundled: bool) -> None:
    """What FMI 2.0.4 asks for and pythonfmu 0.7 leaves out, and no claim that the slave cannot keep."""
    interface = description.find("CoSimulation")
    assert interface is not None
    interface.set("canInterpolateInputs", "false")  # pythonfmu passes no derivatives of inputs on
    if bundled:
        interface.set("needsExecutionTool", "false")
    tool = description.get("generationTool", "")
    if "ps_fmu" not in tool:
        description.set("generationTool", f"ps_fmu {__version__} with {tool}")
    date = description.get("generationDateAndTime", "")
    if date.endswith("+00:00"):
        description.set("generationDateAndTime", date.replace("+00:00", "Z"))
    variables = description.findall("ModelVariables/ScalarVariable")
    for variable in variables:
        if "variability" not in variable.attrib:
            is_parameter = variable.get("causality") in ("parameter", "calculatedParameter")
            if is_parameter or (len(variable) and variable[0].tag != "Real"):  # the default is continuous
                variable.set("variability", "tunable" if is_parameter else "discrete")
    structure = description.find("ModelStructure")
    unknown = [
        index
        for index, variable in enumerate(variables, 1)
        if variable.get("causality") == "calculatedParameter"
        or (
            variable.get("causality") == "output"
            and variable.get("initial") != "exact"
            and variable.get("variability") != "constant"
        )
    ]
    if structure is not None and structure.find("InitialUnknowns") is None and unknown:
        initial = SubElement(structure, "InitialUnknowns")
        for index in unknown:
            SubElement(initial, "Unknown", index=str(index))
