"""The library of an FMU: where it lies in the unpacked folder, and how FMPy loads it."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Collection
from pathlib import Path
from typing import Any

from fmpy import sharedLibraryExtension
from fmpy.fmi2 import FMU2Slave
from fmpy.model_description import ModelDescription

from ..files.archive import check_archive
from ..native import find_platform
from . import guard
from .errors import SystemFileError
from .structure import Component

_NOT_LOADED = "component {!r} cannot be loaded on this platform"


def find_binary(component: Component, description: ModelDescription, folder: Path) -> Path:
    """The library of an unpacked FMU for this platform.  Raises :class:`SystemFileError` if there is none."""
    name = f"{description.coSimulation.modelIdentifier}{sharedLibraryExtension}"
    platform = find_platform()
    path = folder / "binaries" / platform / name
    if path.is_file():
        return path
    members = [member.split("/") for member in check_archive(component.source)]
    others = sorted({parts[1] for parts in members if parts[0] == "binaries" and len(parts) > 2})
    text = f"{_NOT_LOADED.format(component.name)}: no binaries/{platform}/{name} in the FMU, only binaries for "
    raise SystemFileError(component.source, f"{text}{', '.join(others) or 'none'}: ask its maker for {platform}")


class FMU2Library(FMU2Slave):  # FMPy tells the version of FMI by this name
    """The library of an FMU, which stays in the process.

    FMPy would enter its folder to load it, for all threads, and unload it with the instance: the process crashes then
    if threads that the FMU has started, as OpenMP does, live on.
    """

    def __init__(self, description: ModelDescription, folder: Path, name: str, library: Path) -> None:
        self.guid, self.modelIdentifier = description.guid, description.coSimulation.modelIdentifier
        self.unzipDirectory, self.instanceName = str(folder), name
        self.fmiCallLogger, self.requireFunctions = None, True
        self._functions: dict[str, Any] = {}
        self.component: Any = None
        self.callbacks: Any = None
        # The flag keeps it also when the FMU itself unloads it.
        self.dll = ctypes.CDLL(str(library), mode=getattr(os, "RTLD_NODELETE", 0))
        self._loadFunctions()

    def freeLibrary(self) -> None:
        """Keep the library: FMPy calls this when an instance is freed."""


def load_library(component: Component, description: ModelDescription, folder: Path) -> FMU2Library:
    """Load the library of an unpacked FMU.  Raises :class:`SystemFileError`."""
    library = find_binary(component, description, folder)
    try:
        with guard.restore_after_loading(component.name), guard.NamedCall(f"{component.name}: loading the library"):
            return FMU2Library(description, folder, component.name, library)
    except Exception as error:
        text = f"{_NOT_LOADED.format(component.name)}: " + str(error).replace(f"{folder}{os.sep}", "")
        raise SystemFileError(component.source, text + _explain(folder)) from error


def _explain(folder: Path) -> str:
    """What to do where no library can be loaded from the folder; nothing elsewhere."""
    if not hasattr(os, "statvfs") or not os.statvfs(folder).f_flag & os.ST_NOEXEC:
        return ""
    return f". {folder.parent} is on a file system without execution (noexec): set TMPDIR to a folder on another one"


# ---- the library of pythonfmu ---------------------------------------------------------------------------------------


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


def is_pythonfmu(library: ctypes.CDLL) -> bool:
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
    if is_pythonfmu(library):
        library.finalizePythonInterpreter()
