"""Run the system once: a case, stored in a group of results.nc, with a progress bar."""

from __future__ import annotations

import re
import sys
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from time import perf_counter
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column, Event, Master, Observer, Recorder, Value
from ..cosim.description import read_terminal_variables
from ..cosim.errors import SlaveEnded, SlaveError
from ..cosim.faults.binding import ActedFault
from ..cosim.recording.thinner import MemoryRecorder
from ..cosim.structure import parse_port
from ..interface.agreement import APART, Difference, find_differences
from .divergence import Bounds, Divergence, Runaway, describe_loop, explain_divergence
from .index_record import SIGNALS
from .keeping import CaseKeeper, SinceStart, leave_no_empty_file
from .options import RESULTS, RunOptions
from .origin import format_settings, write_origin
from .runner import Runner
from .setup import select_stored
from .stored_rows import make_stored_names, rename_columns, watch_motion
from .system import NOISE, RunSystem

Array = NDArray[np.float64]

QUIET_INTERVAL_S = 10.0  # between the lines of the progress bar in a log file


@dataclass(frozen=True)
class Case:
    """One run of the system within a scenario.

    ``name`` is its group in results.nc.  ``values`` are what makes it this case: start values of parameters and
    inputs by ``component.variable``, stronger than the user's parameter files.
    """

    name: str
    values: Mapping[str, Value] = field(default_factory=dict)
    events: Sequence[Event] = ()
    lead_s: float = 0.0
    """Lead-in, s: it is stored, but is in no statistics, and requirements count their time from its end."""

    @property
    def changed(self) -> set[str]:
        """Names of what the events set."""
        return {name for _, name, _ in self.events}


@dataclass(frozen=True)
class Outcome:
    """How long a case took, and the faults that acted in it."""

    case: Case
    simulated_s: float
    wall_s: float
    faults: tuple[ActedFault, ...] = ()
    begin_s: float = 0.0
    """Time of the simulation at which it began: not zero in the state of a checkpoint."""
    ended: SlaveEnded | None = None
    """The FMU that has ended the simulation, if one has."""

    def find_spans(self) -> list[tuple[float, float]]:
        """When any of the faults acted [s since the start of the case]."""
        return find_spans(self.faults, self.simulated_s, begin_s=self.begin_s)

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds per second."""
        return self.simulated_s / self.wall_s


class RunRecord(Protocol):
    """The results that are computed during a run, block by block."""

    @property
    def observers(self) -> Sequence[Observer]:
        """The observers that feed it."""


A = TypeVar("A", bound=RunRecord)
Progress = Callable[[float, float, float], None]
"""Takes simulated time [s], wall time [s], simulated over wall time."""


def run_case(
    system: RunSystem,
    options: RunOptions,
    case: Case,
    analyse: Callable[[tuple[Column, ...]], A],
    *,
    needs: Collection[str] | None = None,
    duration_s: float | None = None,
) -> tuple[Outcome, A]:
    """Run one case from its start to ``duration_s`` (by default that of the options) and free the FMUs.

    ``analyse`` makes the analysis of the run once its columns are known.  ``needs`` names what it looks at: with an
    option for what is stored, no other outputs are read.  None: all are read in any case.  The lead-in of the case is
    left out of the pointing error indices, which ``system`` collects.  The outputs are stored in the case's group of
    results.nc; what the user should know is added to the warnings of ``system``.

    Raises :class:`ps_fmu.cosim.CosimError` (what is wrong, where and when; of a motion that has grown without limit
    :class:`.divergence.Divergence`) and KeyboardInterrupt; the analysis and the file have then all complete rows.
    """
    try:
        return _run(system, options, case, analyse, needs, options.duration_s if duration_s is None else duration_s)
    except (SlaveError, Divergence) as error:
        if options.is_plain or (said := explain_divergence(error, system, options, case.name, case.values)) is None:
            raise
        raise said from error


def _run(
    system: RunSystem,
    options: RunOptions,
    case: Case,
    analyse: Callable[[tuple[Column, ...]], A],
    needs: Collection[str] | None,
    duration: float,
) -> tuple[Outcome, A]:
    wall = [0.0]
    keeper = CaseKeeper(
        options.output, case.name, options.checkpoint_s, resume=options.resume, source=options.source,
        anew=options.anew, given=case.values.keys(),
        notes=lambda: {"warnings": list(system.warnings.texts), "wall_s": before_s + wall[0]},
    )  # fmt: skip
    before_s = float(keeper.kept_notes.get("wall_s", 0.0))
    for text in keeper.kept_notes.get("warnings", ()):
        system.warnings.add(str(text))

    def note(simulated: float, passed: float, factor: float) -> None:
        wall[0] = passed
        show(simulated - start_s, passed, factor)

    structure = system.structure.with_parameters(case.values)
    costs = system.costs.begin(case.name) if options.profile else None
    runner = Runner(structure) if system.runner is None else system.runner
    opened = runner.open(
        structure, step=options.step_s, scheme=system.scheme, descriptions=system.descriptions,
        stopwatch=None if costs is None else costs.stopwatch, isolation=options.isolation, faults=system.faults,
        start_time=keeper.start_time, inputs=system.inputs, also=system.also,
    )  # fmt: skip
    with (
        leave_no_empty_file(options.output / RESULTS),
        system.warnings.collect(),
        opened as master,
    ):
        start_s = master.time
        texts = [*_list_overruled(system, case), *_list_connected(system, master), *master.faults.remarks]
        if not options.is_plain:
            texts += [*_list_open(system, master, case), *list_mismatches(system, case.values, options.apart)]
            if system.kept is None:
                warn_of_loops(system, options, [case])
        master.faults.check_end(duration)
        for text in texts:
            system.warnings.add(text)
        if options.observe and needs is not None:
            master.record(_list_needed(system, options, case, needs))
        master.initialise()
        analysis = analyse(master.columns)
        steps = round(duration / options.step_s)
        lead_steps = round(case.lead_s / options.step_s)
        own: tuple[Observer, ...] = (
            *system.judge.observe(case.name, master.columns, options.step_s, steps, case.lead_s),
            *system.indices.observe(case.name, master.columns, options.step_s, steps, lead_steps),
        )
        with (
            show_progress(case.name, duration, options.progress) as show,
            _make_recorder(system, master, options, case, duration, keeper.attributes) as recorder,
        ):
            watching = (*analysis.observers, *own)
            judging = [SinceStart(one, options.step_s) for one in watching] if start_s else watching
            bounds: tuple[Observer, ...] = ()
            if not options.is_plain:  # of other systems any number may be right
                describe = partial(describe_loop, system, options, case.values)
                bounds = Bounds(master.columns), Runaway(master.columns, describe)
            observers: list[Observer] = [*bounds, recorder, *judging]
            watched = observers if costs is None else costs.time(observers)
            events = [(start_s + time, name, value) for time, name, value in case.events]
            began = perf_counter()
            master.run(duration, watched, events, note, checkpoints=keeper.checkpoints)
            spent_s = before_s + (wall[0] or perf_counter() - began)
        acted, ended = master.faults.list_acted(master.time), master.ended
        simulated_s = duration if ended is None or ended.time is None else ended.time - start_s
        return Outcome(case, simulated_s, spent_s, acted, start_s, ended), analysis


def warn_of_loops(system: RunSystem, options: RunOptions, cases: Iterable[Case]) -> None:
    """Add a warning for each case whose loops are unstable in the linear model."""
    for case in cases:
        if loop := describe_loop(system, options, case.values):
            system.warnings.add(f"Case {case.name}: {loop}. Its motion grows without limit, and the run stops.")


def _list_needed(system: RunSystem, options: RunOptions, case: Case, needs: Collection[str]) -> set[str]:
    """Names of the columns that are stored, observed or judged, as far as the system has them.

    Of all that it has: the case before may have needed others.
    """
    seen = {*needs, *SIGNALS, *system.judge.list_signals(case.name, system.columns)}
    chosen = select_stored(system.columns, options.observe)
    return {*chosen, *(column.name for column in system.columns if column.name in seen)}


def _make_recorder(
    system: RunSystem, master: Master, options: RunOptions, case: Case, duration_s: float, more: Mapping[str, float]
) -> Recorder | MemoryRecorder:
    attributes: dict[str, str | float] = {
        "scenario": options.scenario.name, "scheme": str(master.scheme), "step_s": options.step_s,
        "duration_s": duration_s, "settings": format_settings(case.values, case.events), **more,
    }  # fmt: skip
    if planned := master.faults.list_acted(master.time + duration_s):
        attributes["faults"] = "; ".join(fault.text for fault in planned)
    if case.lead_s:
        attributes["lead_in_s"] = case.lead_s
    names = make_stored_names([column.name for column in system.columns])
    columns, storage_step = rename_columns(master.columns, names), options.storage_stride * master.step
    select = [names[name] for name in select_stored(master.columns, options.observe)]
    if system.kept is not None:
        return system.kept.record(case.name, columns, master.step, storage_step, select, attributes)
    path = options.output / RESULTS
    if not path.exists():
        write_origin(path, options, system)
    recorder = Recorder(
        path, case.name, columns=columns, step=master.step, storage_step=storage_step, select=select,
        attributes=attributes, append=True, rows=round(duration_s / master.step) + 1,
    )  # fmt: skip
    if (motion := watch_motion(recorder.columns)) is not None:
        system.motions[case.name] = motion
        recorder.watching.append(motion)
    return recorder


def _list_open(system: RunSystem, master: Master, case: Case) -> Iterator[str]:
    """Inputs that somebody forgot: not those that are given a value, and not extras.

    Extras are in none of the FMU's terminals, where it has terminals and some of its inputs are connected: further
    forces on the plant, for example.
    """
    wired = {connection.target.component for connection in master.wiring.connections}
    terminals = {c.name: read_terminal_variables(c.source) for c in system.structure.components if c.name in wired}
    for item in master.open_inputs:
        component, variable = item.port
        given = variable in system.structure.component(component).parameters or str(item.port) in case.values
        members = terminals.get(component)
        if not given and str(item.port) not in case.changed and (members is None or variable in members):
            yield f"{item.port} is not connected and stays at {item.start} {item.unit or ''}".rstrip()


def _list_overruled(system: RunSystem, case: Case) -> Iterator[str]:
    for name, entry in system.given.items():
        if name in case.values.keys() - case.changed and case.values[name] != entry.value:
            yield f"{name} ({entry.origin}) is not used: case {case.name} sets it to {case.values[name]}"


def _list_connected(system: RunSystem, master: Master) -> Iterator[str]:
    sources = {str(connection.target): connection.source for connection in master.wiring.connections}
    for name, entry in system.given.items():
        if name in sources:
            yield f"{name} ({entry.origin}) acts only until the first exchange: it is connected to {sources[name]}"


@contextmanager
def show_progress(name: str, duration_s: float, shown: bool) -> Iterator[Progress]:
    """A bar on the error stream with the simulated seconds and the real-time factor.

    Where the error stream is no terminal, a line every :data:`QUIET_INTERVAL_S`.
    """
    from tqdm import tqdm

    with tqdm(
        total=duration_s,
        desc=name,
        disable=not shown or sys.stderr is None,  # closed by the caller: 2>&-
        bar_format="{desc}: {percentage:3.0f}% |{bar}| {n:.1f}/{total:.1f} s [{elapsed}<{remaining}{postfix}]",
        file=sys.stderr,
        mininterval=0.1 if sys.stderr is not None and sys.stderr.isatty() else QUIET_INTERVAL_S,
    ) as bar:

        def advance(simulated: float, passed: float, factor: float) -> None:
            bar.set_postfix_str(f"{factor:.1f} x real time", refresh=False)
            bar.update(min(simulated, duration_s) - bar.n)  # times are rounded, and a bar ends at its end

        yield advance


def find_spans(faults: Iterable[ActedFault], end_s: float, *, begin_s: float = 0.0) -> list[tuple[float, float]]:
    """When any of the faults acted, to the end of the run at the latest [s]; spans that touch are one.

    Faults have times of the simulation; the spans, and ``end_s``, count from its time ``begin_s``.
    """
    spans: list[tuple[float, float]] = []
    for first, last in sorted(
        (f.from_s - begin_s, end_s if f.until_s is None else min(f.until_s - begin_s, end_s)) for f in faults
    ):
        if spans and first <= spans[-1][1]:
            spans[-1] = spans[-1][0], max(last, spans[-1][1])
        else:
            spans.append((first, last))
    return spans


MOST_SHOWN = 6  # quantities with their values, those that differ most; the others by name


def list_mismatches(system: RunSystem, values: Mapping[str, Value], apart: Iterable[str] = ()) -> Iterator[str]:
    """A text for each component that knows the plant otherwise than it is: the quantities, both values, what to do.

    The disturbance source is passed over where its noise is off: only that acts at the centre of mass of the bus.

    Parameters
    ----------
    values: what a case sets, by ``component.variable``.
    apart: beginnings of names that differ on purpose.  Parameters with the annotation :data:`.agreement.APART` do, too.
    """
    prefixes = tuple(apart)

    def get_value(name: str) -> Value:
        return values[name] if name in values else system.get_start(name)

    def is_meant(name: str) -> bool:
        port = system.structure.find_port(name)
        entry = system.structure.component(port.component).parameters.get(port.variable)
        noted = entry is not None and APART in entry.notes and name not in values
        return noted or any(name == prefix or name.startswith((f"{prefix}.", f"{prefix}_")) for prefix in prefixes)

    found = find_differences(system.descriptions, get_value, is_meant)
    for component, differences in groupby(found, key=lambda difference: difference.component):
        if component != parse_port(NOISE).component or get_value(NOISE):
            yield _describe(component, list(differences))


def _describe(component: str, differences: list[Difference]) -> str:
    largest_first = sorted(differences, key=lambda difference: -difference.relative)
    shown, rest = largest_first[:MOST_SHOWN], largest_first[MOST_SHOWN:]
    named = "; ".join(str(difference) for difference in shown)
    others = dict.fromkeys(re.sub(r"_\d+", "_i", difference.quantity) for difference in rest)
    more = f"; and {len(rest)} more: {', '.join(others)}" if rest else ""
    meant = component if len(differences) > 1 else f"{component}.{differences[0].quantity}"
    return (
        f"{component} describes another mechanism than the plant. {named}{more}. Set both alike in a parameter file "
        f"(ps-fmu parameters writes the values of all FMUs from one file); if you mean it, give --apart {meant}"
    )
