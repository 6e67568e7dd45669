"""Builds the FMUs of a checkout where they are missing or older than their sources."""

from __future__ import annotations

from pathlib import Path

# Parts of the package that are packed into an FMU, and the builder itself.
_PACKED = (
    *(
        f"src/ps_fmu/{room}"
        for room in ("mechanism", "control", "disturbance", "sensors", "actuators", "interface", "slavekit")
    ),
    "fmus",
)


def list_models(root: Path) -> list[str]:
    """Names of the FMUs that the checkout ``root`` builds: ``fmus/manipulator_plant`` makes ``ManipulatorPlant``."""
    scripts = sorted((root / "fmus").glob("*/*.py"))
    return [path.stem.title().replace("_", "") for path in scripts if path.stem == path.parent.name]


def find_newest_source(root: Path) -> float:
    """Time of the last change [s since the epoch] among the sources of the FMUs in the checkout ``root``."""
    files = [path for part in _PACKED for path in (root / part).rglob("*") if "__pycache__" not in path.parts]
    return max((path.stat().st_mtime for path in files if path.is_file()), default=0.0)


def list_outdated(folder: Path, root: Path) -> list[str]:
    """FMUs that are missing from ``folder`` or older than the sources in ``root``."""
    newest = find_newest_source(root)
    files = {name: folder / f"{name}.fmu" for name in list_models(root)}
    return [name for name, path in files.items() if not path.is_file() or path.stat().st_mtime < newest]


def ensure_built(folder: Path, root: Path) -> list[str]:
    """Build the FMUs into ``folder`` if any is out of date; returns the names of those that were.

    Raises what :func:`ps_fmu.slavekit.pack.build.build_all` raises.
    """
    stale = list_outdated(folder, root)
    if stale:
        from ..slavekit.pack.build import build_all

        build_all(folder, root / "fmus")
    return stale
