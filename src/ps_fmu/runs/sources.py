"""The built FMUs of a checkout: are they there, and newer than what they are built from?"""

from __future__ import annotations

from pathlib import Path

FMU_NAMES = ("ManipulatorPlant", "PointingCommander", "FeedforwardIsolator", "DisturbanceSource")

# Parts of the package that are packed into an FMU, and the builder itself.
_PACKED = (*(f"src/ps_fmu/{room}" for room in ("mechanism", "control", "disturbance", "interface", "slavekit")), "fmus")


def newest_source(root: Path) -> float:
    """Time of the last change [s since the epoch] among the sources of the FMUs in the checkout ``root``."""
    files = [path for part in _PACKED for path in (root / part).rglob("*") if "__pycache__" not in path.parts]
    return max((path.stat().st_mtime for path in files if path.is_file()), default=0.0)


def out_of_date(folder: Path, root: Path) -> list[str]:
    """FMUs that are missing from ``folder`` or older than the sources in ``root``."""
    newest = newest_source(root)
    files = {name: folder / f"{name}.fmu" for name in FMU_NAMES}
    return [name for name, path in files.items() if not path.is_file() or path.stat().st_mtime < newest]


def ensure_built(folder: Path, root: Path) -> list[str]:
    """Build the FMUs into ``folder`` if any is out of date; returns the names of those that were.

    Raises what :func:`ps_fmu.slavekit.pack.build.build_all` raises.
    """
    stale = out_of_date(folder, root)
    if stale:
        from ..slavekit.pack.build import build_all

        build_all(folder)
    return stale
