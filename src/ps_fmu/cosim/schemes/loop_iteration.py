"""Steps of a scheme that iterates loops, in Python.

Components are stepped in the order in which they see one another.  Those of a loop are stepped again and again, from
their states at the beginning of the step, until the values that go back in it are those that come out.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from ctypes import c_double, c_int
from dataclasses import replace
from itertools import permutations
from time import perf_counter_ns

import numpy as np

from ..checkpoint.state import Stateful
from ..compiled import CompiledExtension, is_available
from ..errors import SlaveEnded
from ..faults.effects import EffectGroup
from ..fmu_instance import FmuInstance
from ..plan import Gather, Plan, Stage
from ..rows import Array
from ..stopwatch import Stopwatch
from ..structure import PortName
from ..wires import Wires
from .columns import SchemeColumn
from .derivatives import Link, derive, list_links
from .history import InputHistory
from .planning import Sequel, Setting, make_sequel, make_stages
from .resolving import find_loops, find_period
from .running import StageRunner
from .solver import InterfaceSolver, NotConverged
from .states import keep_states, release_states

_MOST_TRIED = 6  # components of a loop of which all orders are tried


class IteratedLoop:
    """Runs steps as :class:`.loops.StepLoop` says.

    Parameters
    ----------
    setting: of the plan
    instances: loaded FMUs by component
    columns: of the scheme
    compiled: have the library find the lines of inputs where there is one; results are the same
    stopwatch: times each call
    """

    plan: Plan | None = None

    def __init__(
        self,
        setting: Setting,
        instances: Mapping[str, FmuInstance],
        columns: Sequence[SchemeColumn],
        compiled: bool,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        wires = setting.wires
        self._setting = setting
        pairs = [(source.component, target.component) for target, source in wires.sources.items() if source.component]
        stages: list[Stage] = []
        sequels: list[Sequel] = []
        known = ["", *instances]  # all see the end of the step, also of the inputs of the run
        period = find_period(setting.scheme)
        self._groups: list[tuple[list[tuple[int, ...]], _Loop | None]] = []
        for members, looped in find_loops(list(instances), pairs):
            order = _choose_order(members, wires) if looped else members
            own = [make_sequel(setting, instances[name], known) for name in order]
            sequels += own
            turns = []
            for phase in range(1 if looped else period):
                begin = len(stages)
                stages += [stage for sequel in own for stage in make_stages([sequel], phase)]
                turns.append(tuple(range(begin, len(stages))))
            faults = [part for stage in stages[begin:] for part in stage.gathers if isinstance(part, EffectGroup)]
            loop = _Loop(setting, [instances[name] for name in order], columns, faults) if looped else None
            self._groups.append((turns, loop))
        self.histories: list[InputHistory] = [s.history for s in sequels if s.history is not None]
        self.memories: list[Stateful] = [
            *self.histories, *(loop.solver for _, loop in self._groups if loop is not None)
        ]  # fmt: skip
        if compiled and is_available():
            stages = [_extend_in_c(stage, setting.now) for stage in stages]
        plan = Plan(tuple(stages), setting.now, setting.step, tuple(wires.signals))
        self._plan = plan
        self._runner = StageRunner(plan, None if stopwatch is None else stopwatch.begin(plan))
        self._period = period
        for column in columns:  # those of a loop that has been cut stay 0
            values, place = setting.rows.find_place(column.port)
            values[place] = 0.0

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`.loops.StepLoop`.  Raises :class:`ConvergenceError`, too."""
        setting, rows, runner = self._setting, self._setting.rows, self._runner
        step = setting.step
        for group in self._plan.effects:
            group.prepare(times)
        fed = [(*rows.find_place(s.port), s.sample(times + step, step)) for s in self._plan.signals]
        for index, time in enumerate(times.tolist()):
            if interrupted:
                return
            began = perf_counter_ns()
            phase = round((time - setting.start) / step) % self._period
            runner.begin(time)
            for values, place, samples in fed:
                values[place] = samples[index]
            try:
                for turns, loop in self._groups:
                    if loop is not None:
                        loop.solve(runner, turns[0], time)
                        continue
                    for number in turns[phase]:
                        runner.run(number, time)
            except SlaveEnded as ended:
                ended.time = time
                raise
            rows.store_latest()
            runner.end(began, time)
            for over in runner.ended.values():
                over.time = time + step
                raise over

    def count_rows(self) -> int:
        """See :class:`.loops.StepLoop`."""
        return self._setting.rows.filled


class _Loop:
    """The components of a loop, in the order of stepping, the values that go back in it, and what faults do in it."""

    def __init__(
        self,
        setting: Setting,
        members: Sequence[FmuInstance],
        columns: Sequence[SchemeColumn],
        faults: Sequence[EffectGroup],
    ) -> None:
        names = [member.name for member in members]
        self._members, self._rows, self._step = members, setting.rows, setting.step
        self._unknowns = [p for p in _list_returning(names, setting.wires) if p in setting.rows.real.places]
        self._places = np.array([setting.rows.real.places[port] for port in self._unknowns], dtype=np.intp)
        by_name = {member.name: member for member in members}
        nominal = [by_name[port.component].get_nominal(port.variable) for port in self._unknowns]
        self.solver = InterfaceSolver(setting.scheme.iteration, np.array(nominal))
        self._faults = faults
        exact = all(member.derives for member in members) and not faults  # those are not in the derivatives of FMUs
        self._links: list[Link] | None = list_links(members, setting.wires) if exact else None
        own = {column.kind: column for column in columns if set(column.members) == set(names)}
        self._columns = [setting.rows.find_place(own[kind].port) for kind in ("passes", "residual") if kind in own]

    def solve(self, runner: StageRunner, stages: Iterable[int], time: float) -> None:
        """Step from ``time`` [s] on.  Raises :class:`ConvergenceError` or :class:`SlaveError`."""
        rows, places = self._rows, self._places
        before, states, at_start = rows.latest.copy(), keep_states(self._members), True
        remembered = [group.keep() for group in self._faults]
        try:

            def evaluate(z: Array) -> Array:
                nonlocal at_start
                if not at_start:
                    for member, state in states.items():
                        member.set_state(state)
                        runner.ended.pop(member.name, None)
                    rows.latest[:] = before
                    for group, kept in zip(self._faults, remembered, strict=True):
                        group.restore(kept)
                at_start = False
                rows.real.values[places] = z
                for number in stages:
                    runner.run(number, time)
                return np.asarray(rows.real.values[places])

            def differentiate() -> Array | None:
                end = time + self._step
                return None if self._links is None else derive(self._links, self._unknowns, end)

            found = self.solver.solve(evaluate, rows.real.values[places], differentiate)
        except NotConverged as failure:
            names = [member.name for member in self._members]
            raise failure.explain("in the step from", names, self._unknowns, time) from None
        finally:
            release_states(states)
        for (values, place), number in zip(self._columns, (found.passes, found.residual), strict=False):
            values[place] = number


def _extend_in_c(stage: Stage, now: c_double) -> Stage:
    gathers = (
        replace(part, extension=CompiledExtension(part.extension, now))
        if isinstance(part, Gather) and part.extension is not None
        else part
        for part in stage.gathers
    )
    return replace(stage, gathers=tuple(gathers))


def _list_returning(order: Iterable[str], wires: Wires) -> list[PortName]:
    """Outputs of components of a loop that go to one which is stepped before, or to their own component."""
    place = {name: number for number, name in enumerate(order)}
    ports = (
        source
        for target, source in wires.sources.items()
        if target.component in place and source.component in place
        and place[source.component] >= place[target.component]
    )  # fmt: skip
    return list(dict.fromkeys(ports))


def _choose_order(members: list[str], wires: Wires) -> list[str]:
    """The order in which the fewest values go back; the first of several."""
    if len(members) > _MOST_TRIED:
        return members
    return list(min(permutations(members), key=lambda order: len(_list_returning(list(order), wires))))
