"""A run of a scenario: its options, and its system once that is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..cosim import System, Value
from ..cosim.description import read_descriptions
from ..cosim.ssp.reading import read_system
from .kept_rows import KeptRows
from .loaded import LoadedSystem
from .options import RunOptions
from .setup import RunSystem, load_system


class Run:
    """The options of a run and its system.

    A scenario loads the system with its own defaults, runs its cases, and returns what it found; who made the run
    publishes that, or does not.

    Parameters
    ----------
    options: of the run
    only: names of the cases that are wanted; empty: all
    shared: the FMUs, which stay loaded; the rows are kept in memory then
    """

    def __init__(self, options: RunOptions, only: tuple[str, ...] = (), shared: SharedSystem | None = None) -> None:
        self.options, self.only = options, only
        self._shared = shared
        self._system: RunSystem | None = None

    @property
    def system(self) -> RunSystem:
        """The system that the scenario has loaded."""
        assert self._system is not None  # a scenario loads it first
        return self._system

    def wants(self, case: str) -> bool:
        """Whether a case is to be run."""
        return not self.only or case in self.only

    def load(self, defaults: Mapping[str, Value] | None = None) -> RunSystem:
        """Load the system with a scenario's defaults, see :func:`.setup.load_system`."""
        shared = self._shared
        if shared is None:
            self._system = load_system(self.options, defaults)
        else:
            system = load_system(self.options, defaults, shared.structure, shared.descriptions)
            self._system = replace(system, kept=KeptRows(), loaded=shared.loaded)
        return self._system


class SharedSystem:
    """What runs of one system share: its files, read once, and its FMUs, which stay loaded.

    Raises :class:`..cosim.CosimError`: the system cannot be read.
    """

    def __init__(self, options: RunOptions) -> None:
        self.structure: System = read_system(options.system, options.fmus)
        self.descriptions = read_descriptions(self.structure)
        self.loaded = LoadedSystem(self.structure)

    def close(self) -> None:
        """Free the FMUs; safe to call twice."""
        self.loaded.close()
