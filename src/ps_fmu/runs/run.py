"""A run of a scenario: its options, and its system once that is loaded."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from ..cosim import Value
from .kept_rows import KeptRows
from .options import RunOptions
from .runner import Runner
from .setup import RunSystem, load_system, read_files, settle_times


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
        """Load the system with a scenario's defaults, see :func:`.setup.load_system`; the options get its times."""
        shared = self._shared
        files = read_files(self.options) if shared is None else shared.files
        self.options = settle_times(self.options, files)
        system = load_system(self.options, defaults, files)
        self._system = system if shared is None else replace(system, kept=KeptRows(), runner=shared.runner)
        return self._system


class SharedSystem:
    """What runs of one system share: its files, read once, and its FMUs, which stay loaded.

    Raises :class:`..cosim.CosimError`: the system cannot be read.
    """

    def __init__(self, options: RunOptions) -> None:
        self.files = read_files(options)
        self.runner = Runner(self.files.structure, stays=True)

    def close(self) -> None:
        """Free the FMUs; safe to call twice."""
        self.runner.close()
