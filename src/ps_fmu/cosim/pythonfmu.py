"""FMUs of plain pythonfmu (0.7): precautions, because their library can crash this process.

FMUs that were built here need none of them: their launcher takes care of it.
"""

from __future__ import annotations

import ctypes
from collections.abc import Collection
from pathlib import Path

MODULE_FILE = "resources/slavemodule.txt"


def find_missing(module_file: bytes | None, files: Collection[str]) -> str | None:
    """What an FMU lacks that the library takes for granted: it crashes in fmi2Instantiate; None if nothing.

    Parameters
    ----------
    module_file: content of MODULE_FILE, None if it is not there
    files: names of all files of the FMU
    """
    if module_file is None:
        return f"there is no {MODULE_FILE}, which names the module of the slave"
    module = module_file.partition(b"\n")[0].decode(errors="backslashreplace")
    script = f"resources/{module}.py"
    return None if script in files else f"there is no {script!r}, the module of the slave by {MODULE_FILE}"


def is_plain(library: ctypes.CDLL) -> bool:
    """Is this pythonfmu's library, loaded without a launcher in front of it?"""
    return hasattr(library, "finalizePythonInterpreter")


def find_missing_in(folder: Path) -> str | None:
    """As :func:`find_missing`, of an FMU that is unpacked in ``folder``."""
    file = folder / MODULE_FILE
    files = {path.relative_to(folder).as_posix() for path in (folder / "resources").glob("*.py")}
    return find_missing(file.read_bytes() if file.is_file() else None, files)


def release_once(library: ctypes.CDLL) -> None:
    """Before the process ends, have the library drop its interpreter state; nothing for libraries of other makers.

    It does so twice otherwise, in a static pointer's destructor and in its own, and the second time writes to freed
    memory: "corrupted double-linked list" in one of some ten runs.  The library exports this call for that purpose.
    """
    if is_plain(library):
        library.finalizePythonInterpreter()
