"""The co-simulated system for an analysis, with FMUs that are up to date with their sources."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..cosim import Column, System, read_system
from ..product.files import find_product
from ..results.observers.sampler import SampleObserver
from ..runs.built_fmus import provide_fmus
from ..runs.options import OptionError, RunOptions, Scenario
from ..runs.output import hold_folder
from .analysis import AnalysisOptions


def check_sources(system: Path) -> None:
    """Check, before anything is written, that FMUs can be built and the system can be read.

    Raises
    ------
    OptionError: there is no system description ``system``; the message says where the product's are.
    FileNotFoundError: the FMUs' sources are not there, since only the package's modules are.
    """
    product = find_product()
    if not system.exists():
        raise OptionError(f"--system: there is no system description {system}; those of ps_fmu are in {product.system}")


def load_built_system(options: AnalysisOptions) -> System:
    """Read the system of the options; builds its FMUs first if they are missing or older than their sources.

    Raises BuildError, CosimError.
    """
    provide_fmus(options.fmus, options.system)
    return read_system(options.system, options.fmus)


@contextmanager
def hold_run(
    options: AnalysisOptions, scenario: Scenario, duration_s: float | None = None, step_s: float | None = None
) -> Iterator[RunOptions]:
    """Options of a scenario's runs, whose folder no other run can use during the body.

    The folder has the scenario's name and is made beside the results of the analysis.  Then the FMUs are built if they
    are missing or older than their sources.  Duration and step, s, are those of the scenario by default.

    Raises BuildError, OptionError.
    """
    run = RunOptions(
        scenario,
        options.system,
        options.output / scenario.name,
        duration_s or scenario.duration_s,
        step_s or scenario.step_s,
        options.seed,
        fmus=options.fmus,
        progress=options.progress,
    ).claim_output()
    provide_fmus(options.fmus, options.system)
    with hold_folder(run.output):
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
