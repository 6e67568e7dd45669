"""The co-simulated system for an analysis, with FMUs that are up to date with their sources."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..cosim import Column, System, read_system
from ..cosim.description import index_variables, read_descriptions, read_start
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


def load_default_system(options: AnalysisOptions, name: str) -> System:
    """As :func:`load_built_system`, for an analysis whose closed form is that of the product's system ``name`` alone.

    Raises :class:`OptionError`, too: a component, a start value or a connection of the system is another one.
    """
    system, default = load_built_system(options), read_system(find_product().system / name, options.fmus)
    found, expected = _list_start_values(system), _list_start_values(default)
    changed = [f"{key} = {found.get(key)}, there {value}" for key, value in expected.items() if found.get(key) != value]
    wires, wanted = ({f"{each.source} to {each.target}" for each in s.connections} for s in (system, default))
    changed += [f"the connection {each}" for each in sorted(wires ^ wanted)]
    if changed:
        more = f", and {len(changed) - 1} more" if changed[1:] else ""
        raise OptionError(
            f"--system: {options.system} is not as {name} of ps_fmu: {changed[0]}{more}: the closed form that the FMUs "
            "are compared with is of that system"
        )
    return system


def _list_start_values(system: System) -> dict[str, object]:
    """Values of all parameters by ``component.parameter``."""
    return {
        f"{component.name}.{name}": component.parameters[name].value
        if name in component.parameters
        else read_start(variable)
        for component, description in zip(system.components, read_descriptions(system).values(), strict=True)
        for name, variable in index_variables(description).items()
        if variable.causality == "parameter"
    }


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
