"""The other tools that the tests run FMUs in or compare with, and what the end of a test run says about them."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@dataclass(frozen=True)
class Importer:
    """A tool by the name that fmus/README.md uses, its package on PyPI, what the tests run in it, what installs it.

    ``environment``: folder of its own virtual environment, where it cannot share that of the tests.
    """

    name: str
    package: str
    runs: str
    install: str = "pip install -c constraints.txt -e '.[dev]'"
    environment: Path | None = None

    @property
    def interpreter(self) -> Path:
        """The Python that has this tool, if any has."""
        return Path(sys.executable) if self.environment is None else self.environment / "bin" / "python"

    @property
    def version(self) -> str | None:
        """The release that is installed, None if none is."""
        folders = sys.path
        if self.environment is not None:
            folders = [str(folder) for folder in self.environment.glob("lib/python*/site-packages")]
        found = next(iter(metadata.distributions(name=self.package, path=folders)), None)
        return None if found is None else found.version


_ALL = (
    Importer("FMPy", "fmpy", "each FMU alone, the .ssp"),
    Importer("libcosim", "libcosimpy", "each FMU alone, the .ssp"),
    Importer("Ecos", "ecospy", "each FMU alone, the .ssp"),
    Importer("FMU container", "fmu-manipulation-toolbox", "the .ssp as one FMU"),
    Importer("PathSim", "pathsim-fmi", "each FMU alone, all four wired"),
    Importer("CoFMUPy", "cofmupy", "each FMU alone, all four wired", "make importers", ROOT / ".venv-importers"),
)
IMPORTERS = {importer.name: importer for importer in _ALL}
PINOCCHIO = Importer("Pinocchio", "pin", "the multibody prototype that the plant is compared with", "make multibody")
"""Not an importer, but it may be missing likewise."""
BASILISK = Importer(
    "Basilisk", "bsk", "the manipulator on a simulated spacecraft", "make basilisk", ROOT / ".venv-basilisk"
)
"""Another one that may be missing."""
PYTHONS = {
    minor: Importer(f"Python 3.{minor}", "ps-fmu", "the installed wheel", "make pythons", ROOT / f".venv-3.{minor}")
    for minor in (11, 12, 13)
    if minor != sys.version_info.minor
}
"""The other versions of Python, by their minor number: they may be missing, too."""

wanted: dict[str, Importer] = {}
"""Those that tests of this process have asked for."""


def interpreter_with(name: str) -> Path:
    """The Python that has this tool.  Skips the test if none has; the end of the test run then names it."""
    importer = wanted[name] = IMPORTERS[name]
    if importer.version is None:
        pytest.skip(f"{name} is not installed: {importer.install}")
    return importer.interpreter


def needs_pinocchio() -> None:
    """Skips the test if Pinocchio is not installed; the end of the test run then says so."""
    wanted[PINOCCHIO.name] = PINOCCHIO
    if PINOCCHIO.version is None:
        pytest.skip(f"{PINOCCHIO.name} is not installed: {PINOCCHIO.install}")


def python_with_basilisk() -> Path:
    """The Python that has Basilisk.  Skips the test if there is none; the end of the test run then says so."""
    wanted[BASILISK.name] = BASILISK
    if BASILISK.version is None:
        pytest.skip(f"{BASILISK.name} is not installed: {BASILISK.install}")
    return BASILISK.interpreter


def other_python(minor: int) -> Path:
    """Python 3.``minor``.  Skips the test if its environment is not there; the end of the test run then says so."""
    python = wanted[f"Python 3.{minor}"] = PYTHONS[minor]
    if python.version is None:
        pytest.skip(f"{python.name} has no environment: {python.install}")
    return python.interpreter


def summary() -> list[str]:
    """Which of the tools that tests have asked for were run, and which were not."""
    there = [f"{i.name} ({i.package} {i.version})" for i in wanted.values() if i.version is not None]
    missing = [i for i in wanted.values() if i.version is None]
    return ([f"run: {', '.join(there)}"] if there else []) + [
        f"NOT RUN: {i.name} ({i.runs}); to run it: {i.install}" for i in missing
    ]
