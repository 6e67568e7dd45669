"""Runs of a scenario for an analysis, with FMUs that are up to date with their sources."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager

from ..analyses.table import AnalysisOptions
from ..cosim import Column
from ..results.observers.sampler import SampleObserver
from ..runs.built_fmus import provide_fmus
from ..runs.options import RunOptions
from ..runs.output import hold_folder
from ..runs.run import Run
from ..runs.scenario import Scenario


@contextmanager
def hold_run(options: AnalysisOptions, scenario: Scenario) -> Iterator[Run]:
    """A scenario's runs, whose folder no other run can use during the body; their FMUs stay loaded from run to run.

    The folder has the scenario's name and is made beside the results of the analysis.  Then the FMUs are built if they
    are missing or older than their sources.

    Raises BuildError, OptionError.
    """
    own = RunOptions(
        scenario,
        options.system,
        options.output / scenario.name,
        scenario.duration_s,
        scenario.step_s,
        options.seed,
        fmus=options.fmus,
        progress=options.progress,
    ).claim_output()
    provide_fmus(options.fmus, options.system)
    with hold_folder(own.output), closing(Run(own, reset=True)) as run:
        yield run


class SampleRecord:
    """What :func:`ps_fmu.runs.cases.run_case` records: rows of a run, an observer for each pair of names and rows."""

    def __init__(self, *wanted: tuple[Sequence[str], Sequence[int]]) -> None:
        self._wanted = wanted
        self.observers: list[SampleObserver] = []

    def __call__(self, columns: tuple[Column, ...]) -> SampleRecord:
        """Make the observers for a run with these columns."""
        self.observers = [SampleObserver(columns, names, rows) for names, rows in self._wanted]
        return self
