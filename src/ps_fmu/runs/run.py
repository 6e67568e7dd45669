"""A run of a scenario: the one way from options to findings, and to results in a folder."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from contextlib import closing, nullcontext
from dataclasses import replace

from ..cosim import Value
from ..cosim.structure import suggest_names
from ..results.figures import Painter
from .built_fmus import find_built_folder, provide_fmus
from .keeping import keep_run
from .options import OptionError, RunOptions
from .output import remove_old_values
from .publish import Done, Findings, publish
from .runner import Runner
from .setup import load_system, read_files, settle_times
from .stored_rows import KeptRows
from .system import RunSystem


class Run:
    """The options of a run and its system.

    A scenario loads the system with its own defaults, runs its cases, and returns what it found; who made the run
    publishes that, or does not.

    Parameters
    ----------
    options: of the run
    only: names of the cases that are wanted; empty: all
    shared: the FMUs, which stay loaded; the rows are kept in memory then
    reset: the FMUs stay loaded from case to case, until :meth:`close`
    """

    def __init__(
        self, options: RunOptions, only: tuple[str, ...] = (), shared: SharedSystem | None = None, reset: bool = False
    ) -> None:
        self.options, self.only = options, only
        self._shared, self._reset = shared, reset
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
        if shared is not None:
            system = replace(system, kept=KeptRows(), runner=shared.runner)
        elif self._reset:
            system = replace(system, runner=Runner(system.structure, stays=True))
        self._system = system
        return system

    def load_original(self, around: Collection[str]) -> RunSystem | None:
        """The system without the FMUs that replace others, but those ``around``; None: there are no others.

        What is found of its runs goes where that of :attr:`system` goes.
        """
        kept = {name: path for name, path in self.options.replace.items() if name in around}
        if kept == self.options.replace:
            return None
        other, mine = load_system(replace(self.options, replace=kept)), self.system
        return replace(
            other, judge=mine.judge, indices=mine.indices, warnings=mine.warnings, costs=mine.costs, kept=mine.kept
        )

    def close(self) -> None:
        """Free the FMUs, if no other run shares them; safe to call twice."""
        if self._reset and self._system is not None and self._system.runner is not None:
            self._system.runner.close()


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


def find(run: Run) -> Findings:
    """Run the cases of the scenario; what comes of them.  Nothing is printed or drawn.

    Raises :class:`.options.OptionError` for a case that the scenario has not.
    """
    scenario = run.options.scenario
    if run.only and not scenario.alone:
        raise OptionError(f"cases: the scenario {scenario.name} always runs all of its cases")
    for name in run.only:
        if name not in (known := scenario.find_cases()):
            raise OptionError(f"cases: there is no {name!r}{suggest_names(name, known)}; there are {', '.join(known)}")
    found: Findings = scenario.load().find(run)
    return found


def build_fmus(options: RunOptions) -> None:
    """Build the FMUs of ps_fmu, where the options name their folder and they are missing or older than their sources.

    Raises BuildError, CosimError, OSError.
    """
    if options.fmus is not None and options.fmus == find_built_folder():
        provide_fmus(options.fmus, options.system)


def execute(options: RunOptions, show: Callable[[str], None] = print) -> Done:
    """Run the scenario of the options; writes results.nc, summary.json, figures and report.html, shows the tables.

    The output folder is held by :func:`.output.hold_folder`, and the FMUs are there, see :func:`build_fmus`.

    Raises
    ------
    OptionError: an option cannot be honoured, as the system shows.
    CosimError, OSError, ValueError: the FMUs cannot be run, or results cannot be written.
    """
    remove_old_values(options)
    with keep_run(options), Painter() if options.figures else nullcontext() as painter:
        with closing(Run(options, reset=True)) as run:
            findings = find(run)
        show(findings.printed)
        return publish(run.options, run.system, findings, show, painter)
