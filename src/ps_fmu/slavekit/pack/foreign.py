"""FMUs of slaves that know pythonfmu alone: built from a script, or by pythonfmu's own builder (``ps-fmu wrap``).

The author's files stay as they are.  What is added: the launcher, a script that loads the slave with modules of its
own and a border to the library (:mod:`..author.pythonfmu_slave`), and on demand a Python.  The model description
claims what a trial run has confirmed, and gets what validators miss in pythonfmu's.  An FMU to be wrapped may come from
anywhere: nothing in it is believed unchecked.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

import pythonfmu

from ... import __version__
from ...files.archive import compute_digest, read_all, read_member, write_zip
from ...files.plain import SystemFileError, write_atomically
from ...files.xmlfile import MAXIMUM_BYTES, parse_xml
from ...native import list_platforms
from . import pythonfmu_build
from .build import build_slave
from .bundle import check as check_bundle
from .errors import BuildError
from .launch import PACKAGE, RESOURCES, add_modules, add_notes, check_interpreter, name_package, put_launcher_in_front
from .licenses import collect_source_licenses
from .modules import write_loading_entry
from .sources import Files, collect_imported, find_beside, find_imports, find_needed_modules
from .stages import StateError, check_trial

_TIMEOUT = 600.0  # s; the author's modules may take their time
_TAKEN = sys.stdlib_module_names | {"pythonfmu"}
_KIT = ("ps_fmu.slavekit.author.pythonfmu_slave",)
_STATE, _BYTES = "canGetAndSetFMUstate", "canSerializeFMUstate"
_COMPILED = (".so", ".pyd", ".dylib", ".dll")
_REQUIREMENT = re.compile(r"[A-Za-z0-9][A-Za-z0-9._-]*")
_ELSEWHERE = re.compile(r"""platform\w*\s*==\s*["'](win32|cygwin|Windows|darwin|Darwin)""")
_DESCRIPTION = PurePosixPath("modelDescription.xml")
_IDENTIFIER = re.compile(r"[A-Za-z_]\w{0,199}", re.ASCII)
_EXIT = b"finalizePythonInterpreter"  # pythonfmu's library has it from 0.7 on, and the launcher needs it


def build_script(
    script: Path, more: Sequence[Path] = (), output: Path = Path(), *, interpreter: Path | None = None,
    bundled: bool = False,
) -> tuple[Path, list[str]]:  # fmt: skip
    """Build the FMU of the slave in a script into the folder ``output``, as ``<model>.fmu``.

    Parameters
    ----------
    script: defines a class that derives from ``pythonfmu.Fmi2Slave``.  It is run.  The modules and packages beside it
        that it imports go with it.
    more: other files and folders that go with it, for example data.
    output, interpreter, bundled: as for :func:`wrap`.

    Returns
    -------
    tuple: path of the FMU; remarks, a line each.

    Raises
    ------
    BuildError: there is no such slave, or it does not run; with the author's traceback where it is due to his code.
    """
    script = script.resolve()
    output.mkdir(parents=True, exist_ok=True)
    if imports_the_kit(script):
        if more:
            raise BuildError(f"{script}: a slave that imports ps_fmu takes no other files; {more[0]} is one")
        return build_slave(script, output, interpreter=interpreter, bundled=bundled), []
    files = _list_files(script, more)
    with tempfile.TemporaryDirectory(prefix="ps_fmu_build_") as folder:
        stock = Path(folder) / f"{script.stem}.fmu"
        _run_builder(script, stock, files)
        return wrap(stock, output, interpreter=interpreter, bundled=bundled, source=script)


def imports_the_kit(script: Path) -> bool:
    """Does a script import ps_fmu, as slaves with its base class do?  Raises BuildError."""
    if script.suffix != ".py" or not script.is_file():
        raise BuildError(f"{script}: expected a file .py with a class that derives from pythonfmu.Fmi2Slave")
    return any(name.partition(".")[0] == "ps_fmu" for name in find_imports(script.read_bytes(), str(script), ""))


def _list_files(script: Path, more: Iterable[Path]) -> list[Path]:
    """The files and folders that go with the script.  Raises BuildError if one cannot."""
    if not (script.stem.isidentifier() and script.stem.isascii()):
        raise BuildError(f"{script}: this cannot be the name of a slave's file; expected letters, digits, underscores")
    files = {path.resolve() for path in (*more, *find_beside(script))} - {script}
    for path in (script, *sorted(files)):
        if path.stem in _TAKEN and path.suffix in (".py", ""):
            raise BuildError(f"{path}: a module of Python or pythonfmu has this name too, so rename it")
        if not path.exists():
            raise BuildError(f"{path}: no such file or folder")
        if path == script.parent or path in script.parents:
            raise BuildError(f"{path} is a folder above {script.name}: name the files in it that the slave needs")
    names = [path.name for path in sorted(files)]
    twice = sorted({name for name in names if names.count(name) > 1 or name == script.name})
    if twice:
        raise BuildError(f"two files are called {twice[0]}: in an FMU all lie in one folder, so rename one")
    return sorted(files)


def _run_builder(script: Path, stock: Path, files: Iterable[Path]) -> None:
    search = [os.path.abspath(entry) for entry in sys.path if entry]
    program = [sys.executable, "-I", "-B", pythonfmu_build.__file__]
    command = [*program, str(script), str(stock), json.dumps(search), *map(str, files)]
    try:
        run = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=_TIMEOUT)
    except subprocess.TimeoutExpired:
        raise BuildError(f"{script}: it was not built within {_TIMEOUT:g} s") from None
    if run.returncode != 0 or not stock.is_file():  # os._exit(0)
        raise BuildError(f"{script}: the slave cannot be built:\n{run.stdout}{run.stderr}".rstrip())


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
    except BuildError as error:
        raise BuildError(f"{source or fmu}: {error}") from None
    target.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(target, content)
    return target, remarks


def _try_claims(stock: Stock, interpreter: Path | None, bundled: bool) -> tuple[bytes, list[str]]:
    """The FMU with the most claims of its author that the trial run confirms, and what was taken back."""
    remarks: list[str] = []
    interface = stock.description.find("CoSimulation")
    assert interface is not None
    with tempfile.TemporaryDirectory(prefix="ps_fmu_wrap_") as folder:
        trial = Path(folder) / f"{stock.model}.fmu"
        while True:  # each round takes a claim back
            write_zip(trial, _add_launcher(stock, interpreter))
            try:
                check_trial(trial)
                break
            except StateError as error:
                claim = _BYTES if interface.get(_BYTES) == "true" else _STATE
                interface.set(claim, "false")
                remarks.append(f"{claim} is taken back: {error}")
        if bundled:
            write_zip(trial, _add_launcher(stock, interpreter, bundled=True))
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
    files[_DESCRIPTION] = tostring(stock.description)
    digest = compute_digest(files | kit)
    package, tag = name_package(kit), digest.hex()[:12]
    names = sorted(_find_private_names(inside))
    add_modules(
        files, package, {name.relative_to("ps_fmu"): content for name, content in kit.items()}, f"{stock.script}_{tag}",
        lambda archived: write_loading_entry(package, archived, f"fmu_{tag}", stock.script, names),
    )  # fmt: skip
    files |= put_launcher_in_front(files, stock.model)
    guid = add_notes(
        files, stock.model, digest, modules, collect_source_licenses({}), "launcher",
        interpreter=interpreter, bundled=bundled, requirements=_find_requirements(inside),
    )  # fmt: skip
    stock.description.set("guid", guid)
    files[_DESCRIPTION] = tostring(stock.description, encoding="UTF-8", xml_declaration=True) + b"\n"
    return files


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


@dataclass(frozen=True)
class Stock:
    """The parts of an FMU that :func:`read_stock` has checked."""

    files: Files
    description: Element
    model: str
    """The model identifier."""
    script: str
    """Name of the module with the slave."""


def read_stock(path: Path) -> Stock:
    """Read an FMU that ``pythonfmu build`` has made.  Raises BuildError for every other file."""
    try:
        files = read_all(path)
        content = read_member(path, _DESCRIPTION.name, MAXIMUM_BYTES)
        parse_xml(content, Path(_DESCRIPTION))
    except SystemFileError as error:
        raise BuildError(error.text if error.path == path else str(error)) from None
    description = fromstring(content)
    version = description.get("fmiVersion", "none")
    if description.tag != "fmiModelDescription" or version != "2.0":
        raise BuildError(f"this is an FMU of FMI {version:.20}; expected FMI 2.0, the version of pythonfmu")
    if RESOURCES / "launcher.txt" in files:
        raise BuildError("this FMU has a launcher already: use it as it is")
    interface = description.find("CoSimulation")
    if RESOURCES / "slavemodule.txt" not in files or interface is None:
        raise BuildError("this FMU was not made by pythonfmu: expected resources/slavemodule.txt and co-simulation")
    model = interface.get("modelIdentifier", "")
    script = files[RESOURCES / "slavemodule.txt"].decode(errors="replace").partition("\n")[0].strip()
    for name, what in ((model, "modelIdentifier"), (script, "resources/slavemodule.txt")):
        if not _IDENTIFIER.fullmatch(name):
            raise BuildError(f"{what} is {name[:40]!r}; expected a name of letters, digits and underscores")
    if RESOURCES / f"{script}.py" not in files:
        raise BuildError(f"resources/{script}.py is missing, which resources/slavemodule.txt names")
    _check_libraries(files, model, description.get("generationTool", "an unknown tool"))
    return Stock(files, description, model, script)


def _check_libraries(files: Files, model: str, tool: str) -> None:
    """One library at least is pythonfmu's, of a release and for a platform that the launcher goes with."""
    libraries = {
        name.parent.name: content
        for name, content in files.items()
        if name.parts[0] == "binaries" and len(name.parts) == 3 and name.stem == model
    }
    known = list_platforms("launcher")
    usable = libraries.keys() & set(known)
    if not usable:
        found = ", ".join(sorted(libraries)) or "no platform at all"
        raise BuildError(f"it has a library for {found[:80]}; there is a launcher for {', '.join(known)}")
    old = sorted(platform for platform in usable if _EXIT not in libraries[platform])
    if old:
        raise BuildError(f"its library for {', '.join(old)}, by {tool[:40]}, is not of pythonfmu 0.7: build it again")
