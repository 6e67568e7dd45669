"""What all scenarios share: read the system, run a case of it, follow the progress, collect the origin."""

from __future__ import annotations

import logging
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

from ..cosim import Column, Event, Master, Observer, Recorder, System, Value, read_parameters, read_system
from ..pointing.summary import FmuFile
from .options import RESULTS, RunOptions


@dataclass(frozen=True)
class Case:
    """One run of the system within a scenario.

    ``name`` is its group in results.nc.  ``values`` are what makes it this case: start values of parameters and
    inputs by ``component.variable``, stronger than the user's parameter files.
    """

    name: str
    values: Mapping[str, Value] = field(default_factory=dict)
    events: Sequence[Event] = ()


@dataclass(frozen=True)
class Outcome:
    """How a case went: seconds that passed, and what the user should know."""

    case: Case
    columns: tuple[Column, ...]
    simulated_s: float
    wall_s: float
    warnings: tuple[str, ...]

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return self.simulated_s / self.wall_s


Observe = Callable[[tuple[Column, ...]], Sequence[Observer]]
"""Makes the observers of a case, once the columns are known."""
Progress = Callable[[float, float, float], None]
"""Takes simulated time [s], wall time [s], simulated over wall time."""


def load_system(options: RunOptions, defaults: Mapping[str, Value] | None = None) -> System:
    """The system of the options, with the scenario's ``defaults``, the seed, and then the user's parameter files.

    Raises :class:`ps_fmu.cosim.SystemFileError` or :class:`ps_fmu.cosim.UsageError` naming the file and line.
    """
    system = read_system(options.system, options.fmus)
    system = system.with_parameters({**(defaults or {}), "disturbance.seed": options.seed})
    for path in options.parameters:
        system = system.with_parameters(read_parameters(path))
    return system


def run_case(
    system: System,
    options: RunOptions,
    case: Case,
    observe: Observe,
    *,
    duration_s: float | None = None,
    select: Sequence[str] | None = None,
) -> Outcome:
    """Run one case from its start to ``duration_s`` (by default that of the options) and free the FMUs.

    All outputs, or the columns in ``select``, are stored in the case's group of results.nc.  Raises
    :class:`ps_fmu.cosim.CosimError` (what is wrong, where and when) and KeyboardInterrupt; the observers and
    the file have then all complete rows.
    """
    duration = options.duration_s if duration_s is None else duration_s
    wall = [0.0]

    def note(simulated: float, passed: float, factor: float) -> None:
        wall[0] = passed
        show(simulated, passed, factor)

    with (
        _warnings() as messages,
        Master(system.with_parameters(case.values), options.step_s, options.scheme) as master,
        progress_bar(case.name, duration, options.progress) as show,
        _recorder(master, options, case, select) as recorder,
    ):
        master.initialise()
        master.run(duration, [recorder, *observe(master.columns)], case.events, note)
        return Outcome(case, master.columns, duration, wall[0], (*_unconnected(master, case), *messages))


def _recorder(master: Master, options: RunOptions, case: Case, select: Sequence[str] | None) -> Recorder:
    path = options.output / RESULTS
    return Recorder(
        path,
        case.name,
        columns=master.columns,
        step=master.step,
        storage_step=options.storage_step_s,
        select=select,
        attributes={"scenario": options.scenario, "scheme": options.scheme, "seed": options.seed},
        append=path.exists(),
    )


def _unconnected(master: Master, case: Case) -> Iterator[str]:
    chosen = {*case.values, *(name for _, name, _ in case.events)}
    for item in master.open_inputs:
        if str(item.port) not in chosen:
            yield f"{item.port} is not connected and stays at {item.start} {item.unit or ''}".rstrip()


@contextmanager
def _warnings() -> Iterator[list[str]]:
    """Collects what the co-simulation warns of, each text once, and shows it above the progress bar."""
    from tqdm import tqdm

    texts: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            if (text := record.getMessage()) not in texts:
                texts.append(text)
                tqdm.write(text, file=sys.stderr)

    collector = Collector(logging.WARNING)
    logger = logging.getLogger("ps_fmu.cosim")
    logger.addHandler(collector)
    try:
        yield texts
    finally:
        logger.removeHandler(collector)


@contextmanager
def progress_bar(name: str, duration_s: float, shown: bool) -> Iterator[Progress]:
    """A bar on the error stream with the simulated seconds and the real-time factor."""
    from tqdm import tqdm

    form = "{desc}: {percentage:3.0f}% |{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}{postfix}]"
    with tqdm(total=duration_s, desc=name, disable=not shown, bar_format=form, file=sys.stderr) as bar:

        def advance(simulated: float, passed: float, factor: float) -> None:
            bar.set_postfix_str(f"{factor:.1f} x real time", refresh=False)
            bar.update(simulated - bar.n)

        yield advance


def fmu_files(system: System) -> tuple[FmuFile, ...]:
    """Name and SHA-256 of each FMU of the system."""
    return tuple(FmuFile.of(component.source) for component in system.components)


def given_parameters(options: RunOptions) -> dict[str, object]:
    """Options and changed parameters of a run, for the report."""
    given: dict[str, object] = {
        "scenario": options.scenario,
        "duration (s)": options.duration_s,
        "step (s)": options.step_s,
        "scheme": options.scheme,
        "seed": options.seed,
    }
    for path in options.parameters:
        given.update(read_parameters(path))
    return given


def text_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table for the terminal: the first column left-aligned, the others right-aligned."""
    lines = [list(header), *map(list, rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(header))]
    aligned = [
        "  ".join(text.rjust(width) if column else text.ljust(width) for column, (text, width) in enumerate(pairs))
        for pairs in (list(zip(line, widths, strict=True)) for line in lines)
    ]
    return "\n".join([aligned[0], "-" * len(aligned[0]), *aligned[1:]])
