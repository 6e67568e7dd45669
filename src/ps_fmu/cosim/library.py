"""The library of an FMU: where it lies in the unpacked folder, and how FMPy loads it."""

from __future__ import annotations

import os
import threading
from pathlib import Path

from fmpy import platform, sharedLibraryExtension
from fmpy.fmi2 import FMU2Slave
from fmpy.model_description import ModelDescription

from . import guard
from .archive import check_archive
from .errors import SystemFileError
from .structure import Component

_NOT_LOADED = "component {!r} cannot be loaded on this platform"
_LOADING = threading.Lock()  # the working directory, which FMPy changes, is that of all threads


def find_binary(component: Component, description: ModelDescription, folder: Path) -> Path:
    """The library of an unpacked FMU for this platform.  Raises :class:`SystemFileError` if there is none."""
    name = f"{description.coSimulation.modelIdentifier}{sharedLibraryExtension}"
    path = folder / "binaries" / platform / name
    if path.is_file():
        return path
    members = [member.split("/") for member in check_archive(component.source)]
    others = sorted({parts[1] for parts in members if parts[0] == "binaries" and len(parts) > 2})
    text = f"{_NOT_LOADED.format(component.name)}: the FMU has no binaries/{platform}/{name}; it has binaries for "
    raise SystemFileError(component.source, f"{text}{', '.join(others) or 'none'}: ask its maker for {platform}")


def load_library(component: Component, description: ModelDescription, folder: Path) -> FMU2Slave:
    """Load the library; FMPy changes the working directory for that and leaves it changed when it fails."""
    with _LOADING:
        directory = Path.cwd()
        try:
            with guard.divert_ends(), guard.NamedCall(f"{component.name}: loading the library"):
                return FMU2Slave(
                    guid=description.guid,
                    unzipDirectory=str(folder),
                    modelIdentifier=description.coSimulation.modelIdentifier,
                    instanceName=component.name,
                )
        except Exception as error:
            text = f"{_NOT_LOADED.format(component.name)}: " + str(error).replace(f"{folder}{os.sep}", "")
            raise SystemFileError(component.source, text) from error
        finally:
            os.chdir(directory)
