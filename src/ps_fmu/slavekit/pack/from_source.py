"""An FMU that loads anywhere from a slave of pythonfmu: ``ps-fmu build my_slave.py``."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path

from . import pythonfmu_build
from .build import build_one
from .errors import BuildError
from .sources import SourceError, find_beside, find_imports
from .wrap import wrap

_TIMEOUT = 600.0  # s; the author's modules may take their time
_TAKEN = sys.stdlib_module_names | {"pythonfmu"}


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
    output, interpreter, bundled: as for :func:`.wrap.wrap`.

    Returns
    -------
    tuple: path of the FMU; remarks, a line each.

    Raises
    ------
    BuildError: there is no such slave, or it does not run; with the author's traceback where it is due to his code.
    """
    script = script.resolve()
    output.mkdir(parents=True, exist_ok=True)
    try:
        with_kit = imports_the_kit(script)
        files = [] if with_kit else _list_files(script, more)
    except SourceError as error:
        raise BuildError(str(error)) from None
    if with_kit:
        if more or script.parent.name != script.stem:
            raise BuildError(
                f"{script}: a slave that imports ps_fmu lies in a folder {script.stem} of its own, with a README.md; "
                "all that it needs beside it is in ps_fmu"
            )
        return build_one(script.parent, output, interpreter=interpreter, bundled=bundled), []
    with tempfile.TemporaryDirectory(prefix="ps_fmu_build_") as folder:
        stock = Path(folder) / f"{script.stem}.fmu"
        _run_builder(script, stock, files)
        return wrap(stock, output, interpreter=interpreter, bundled=bundled, source=script)


def imports_the_kit(script: Path) -> bool:
    """Does a script import ps_fmu, as slaves with its base class do?  Raises BuildError, SourceError."""
    if script.suffix != ".py" or not script.is_file():
        raise BuildError(f"{script}: expected a file .py with a class that derives from pythonfmu.Fmi2Slave")
    return any(name.partition(".")[0] == "ps_fmu" for name in find_imports(script.read_bytes(), str(script), ""))


def _list_files(script: Path, more: Iterable[Path]) -> list[Path]:
    """The files and folders that go with the script.  Raises BuildError if one cannot, SourceError."""
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
