"""From a folder in ``fmus/`` to an FMU file that stands alone and is reproducible.

pythonfmu's builder contributes native libraries and model description.  What this adds: only the Python
files that the slave needs; terminals, icon, documentation and licences; a GUID from the content; the same bytes from
the same source, in Python of one minor version.  Each FMU has run by itself before it is written.

In an FMU ``ps_fmu`` has a name made from the content of all that the FMUs of one folder need of it.  FMUs of one build
so have one copy of it in a process, those of two builds have two.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import re
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path, PurePosixPath
from typing import Any

import pythonfmu
from pythonfmu.builder import FmuBuilder, get_model_class

from ...files.archive import compute_digest, read_all, write_zip
from ...files.plain import write_atomically
from ..author.description import CAPABILITIES
from ..author.slave import Slave
from ..author.terminals import write_terminals
from .bundle import check as check_bundle
from .errors import BuildError
from .launch import (
    DOCUMENTATION,
    PACKAGE,
    RESOURCES,
    add_modules,
    add_notes,
    check_interpreter,
    name_package,
    put_launcher_in_front,
)  # fmt: skip
from .licenses import collect_source_licenses
from .modules import write_entry
from .page import write_page
from .sources import Files, collect_modules, find_imports, find_needed_modules, rename_imports
from .stages import check_trial

_DESCRIPTION = PurePosixPath("modelDescription.xml")
_TERMINALS = PurePosixPath("terminalsAndIcons", "terminalsAndIcons.xml")
_ICON = PurePosixPath("model.png")
_NO_TOOL_NEEDED = b'needsExecutionTool="true"', b'needsExecutionTool="false"'
_GUID = re.compile(rb'guid="[^"]*"')


def find_folders(fmus: Path, only: Iterable[str] = ()) -> list[Path]:
    """The folders ``<name>`` below ``fmus`` that hold a ``<name>.py``; all, or those named.

    Raises BuildError if there are none, or one of those named is missing.
    """
    scripts = [path for path in sorted(fmus.glob("*/*.py")) if path.stem == path.parent.name]
    found = {path.stem: path.parent for path in scripts}
    missing = [name for name in only if name not in found]
    if missing or not found:
        wanted = ", ".join(missing) or "<name>/<name>.py"
        raise BuildError(f"{fmus}: no {wanted}; found {', '.join(found) or 'nothing'}")
    return [found[name] for name in only] or list(found.values())


def build_all(output: Path, fmus: Path, only: Iterable[str] = (), **variant: Any) -> list[Path]:
    """Build the FMUs whose sources are in the folders of ``fmus`` into the folder ``output``; their paths.

    As :func:`build_one` otherwise.
    """
    return [build_one(folder, output, **variant) for folder in find_folders(fmus, only)]


def build_one(folder: Path, output: Path, **variant: Any) -> Path:
    """Build the FMU of the slave in ``folder``, see :func:`build_slave`."""
    folder = folder.resolve()
    return build_slave(folder / f"{folder.name}.py", output, **variant)


def build_slave(script: Path, output: Path, *, interpreter: Path | None = None, bundled: bool = False) -> Path:
    """Build the FMU of a :class:`..author.slave.Slave` into the folder ``output``, as ``<class>.fmu``; its path.

    Parameters
    ----------
    script: in a folder of its name, which is one of a folder of sources that share their copy of ps_fmu; or anywhere
        else.
    interpreter: noted in the FMU as the Python for hosts that do not run one; that ties the FMU to this machine.
    bundled: put a Python of its own into the FMU, see :mod:`.bundle`.

    Raises
    ------
    BuildError: the sources are not complete or not as they have to be, or the FMU does not run by itself.
    """
    if not script.is_file():
        raise BuildError(f"{script.stem}: no {script}")
    check_interpreter(interpreter)
    output.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="ps_fmu_build_") as temporary:
        try:
            stock, slave = _run_pythonfmu(script, Path(temporary))
            name, files = _repackage(stock, slave, script, interpreter, bundled)
            fmu = Path(temporary) / f"{name}.fmu"
            write_zip(fmu, files)
            check_trial(fmu)
            if bundled:
                check_bundle(fmu)
        except BuildError as error:
            raise BuildError(f"{script.stem}: {error}") from None
        result = output / fmu.name
        write_atomically(result, fmu.read_bytes())
    return result


def _run_pythonfmu(script: Path, output: Path) -> tuple[Path, type[Slave]]:
    """pythonfmu's own FMU and the slave's class; what its builder does to this process is undone."""
    with _undo_imports(script.stem), contextlib.redirect_stdout(io.StringIO()):
        try:
            fmu = Path(FmuBuilder.build_FMU(script, dest=output / "stock.fmu", **CAPABILITIES))
            return fmu, get_model_class(script)
        except (Exception, SystemExit) as error:
            raise BuildError(f"{type(error).__name__}: {error}") from error


@contextlib.contextmanager
def _undo_imports(script: str) -> Iterator[None]:
    """The builder imports the script under its bare name, and leaves its folder on sys.path."""
    path, bytecode, before = sys.path[:], sys.dont_write_bytecode, sys.modules.pop(script, None)
    sys.dont_write_bytecode = True  # no __pycache__ among the sources
    try:
        yield
    finally:
        sys.path[:] = path
        sys.dont_write_bytecode = bytecode
        sys.modules.pop(script, None)
        if before is not None:
            sys.modules[script] = before


def _repackage(
    stock: Path, slave: type[Slave], script: Path, interpreter: Path | None, bundled: bool
) -> tuple[str, Files]:
    """Model name and files of the final FMU, from pythonfmu's and the sources."""
    built = read_all(stock)
    model = _read_model_name(built[_DESCRIPTION])
    files = put_launcher_in_front(built, model)
    files[_DESCRIPTION] = _GUID.sub(b'guid=""', built[_DESCRIPTION], count=1)
    sources = _collect_sources(script)
    shared = _collect_shared_sources(script.parent.parent) if _has_own_folder(script) else _collect_modules(script)
    package = name_package(shared)
    files |= _write_documentation(script, slave, files[_DESCRIPTION])
    digest = compute_digest(files | sources | {RESOURCES / package: b""})
    module = f"{script.stem}_{hashlib.sha256(script.read_bytes()).hexdigest()[:12]}"
    names = {"ps_fmu": package, "pythonfmu": f"{package}.pythonfmu"}
    inside: Files = {}
    for name, content in sources.items():
        if name.suffix == ".py":
            content = rename_imports(content, str(name), names)
        place = name.relative_to("ps_fmu") if name.parts[0] == "ps_fmu" else name
        if name == _place_of(script):
            place = place.with_stem(module)  # FMUs that share the package may have another slave of this name
        inside[place] = content
    entry = f"{script.stem}_{digest.hex()[:12]}"
    add_modules(files, package, inside, entry, lambda archived: write_entry(package, archived, module, model))
    needed, licenses = find_needed_modules(f"ps_fmu.{script.stem}", sources), collect_source_licenses(sources)
    guid = add_notes(files, model, digest, needed, licenses, interpreter=interpreter, bundled=bundled)
    files[_DESCRIPTION] = files[_DESCRIPTION].replace(b'guid=""', f'guid="{guid}"'.encode(), 1)
    if bundled:
        files[_DESCRIPTION] = files[_DESCRIPTION].replace(*_NO_TOOL_NEEDED, 1)
    return model, files


def _read_model_name(description: bytes) -> str:
    match = re.search(rb'modelIdentifier="(\w+)"', description)
    if match is None:
        raise BuildError("pythonfmu wrote a model description without modelIdentifier")
    return match[1].decode()


def _place_of(script: Path) -> PurePosixPath:
    return PurePosixPath("ps_fmu", script.name)


def _collect_shared_sources(fmus: Path) -> Files:
    """The modules that any FMU of the folder needs, by their names in the checkout: all have the package in common.

    A folder from which no FMU can be made counts for nothing: its errors are its own.
    """
    files: Files = {}
    for folder in find_folders(fmus):
        with contextlib.suppress(BuildError):
            files |= _collect_modules(folder / f"{folder.name}.py")
    return files


def _collect_modules(script: Path) -> Files:
    """The modules that a script needs."""
    roots = {"ps_fmu": PACKAGE, "pythonfmu": Path(pythonfmu.__file__).parent}
    return collect_modules(script, roots, hollow=("pythonfmu",))


def _collect_sources(script: Path) -> Files:
    """The script and the modules that it needs, by their names in the checkout."""
    for name in find_imports(script.read_text(encoding="utf-8"), script.name, ""):
        helper = script.with_name(f"{name.partition('.')[0]}.py")
        if helper.is_file():
            raise BuildError(f"{script.name} imports {helper.name} beside it: move that to ps_fmu to have it packaged")
    sources = _collect_modules(script)
    place = _place_of(script)
    if place in sources or (PACKAGE / script.stem).is_dir():
        raise BuildError(f"{script.name} has the name of a module of ps_fmu: give it another one")
    return sources | {place: script.read_bytes()}


def _has_own_folder(script: Path) -> bool:
    return script.parent.name == script.stem


def _write_documentation(script: Path, slave: type[Slave], description: bytes) -> Files:
    """What no simulation needs: page, terminals, icon; the page is the README of the folder, or the script's text."""
    readme, icon = script.with_name("README.md"), script.with_name("icon.png")
    own = _has_own_folder(script)
    text = ast.get_docstring(ast.parse(script.read_bytes())) or ""
    if own and readme.is_file():
        text = readme.read_text(encoding="utf-8")
    if not text:
        place = f", or {readme}," if own else ""
        raise BuildError(f"a docstring at the top of {script.name}{place} becomes the FMU's documentation: write one")
    try:
        terminals = write_terminals(slave.terminals, slave.layout) if slave.terminals else None
        files = {DOCUMENTATION / "index.html": write_page(text, description, terminals)}
    except (KeyError, ValueError) as error:
        raise BuildError(str(error.args[0])) from None
    if terminals is not None:
        files[_TERMINALS] = terminals
    if own and icon.is_file():
        files[_ICON] = icon.read_bytes()
    return files
