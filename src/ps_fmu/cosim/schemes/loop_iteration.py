"""Steps of a scheme that iterates loops.

Components are stepped in the order in which they see one another.  Those of a loop are stepped again and again, from
their states at the beginning of the step, until the values that go back in it are those that come out.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from ctypes import c_int
from functools import partial
from itertools import permutations
from time import perf_counter_ns

import numpy as np

from ..checkpoint.state import Stateful
from ..clock import ends_at
from ..compiled import CompiledLoop
from ..errors import SlaveEnded
from ..faults.effects import EffectGroup
from ..fmu_instance import FmuInstance, keep_states, release_states
from ..plan import Operation, Plan
from ..rows import Array
from ..stopwatch import Stopwatch
from ..structure import PortName
from ..wires import Wires
from .history import InputHistory
from .planning import Sequel, list_operations, make_sequel
from .resolving import find_loops, find_period
from .solver import InterfaceSolver, Link, NotConverged, derive, list_links

_MOST_TRIED = 6  # components of a loop of which all orders are tried


class IteratedLoop:
    """Runs steps as :class:`..compiled.StepLoop` says.

    Parameters
    ----------
    wires: of the system
    stopwatch: times each call
    """

    def __init__(
        self,
        wires: Wires,
        stopwatch: Stopwatch | None = None,
    ) -> None:
        parts, instances = wires.parts, wires.instances
        self._rows, self._start, self._step = parts.rows, parts.clock.start, wires.step
        pairs = [(source.component, target.component) for target, source in wires.sources.items() if source.component]
        ranges: list[list[Operation]] = [[*wires.make_feeds()]]
        sequels: list[Sequel] = []
        known = ["", *instances]  # all see the end of the step, also of the inputs of the run
        self._period = find_period(parts.scheme)
        self._groups: list[tuple[range, _Loop | None]] = []
        for members, looped in find_loops(list(instances), pairs):
            order = _choose_order(members, wires) if looped else members
            own = [make_sequel(wires, instances[name], known) for name in order]
            sequels += own
            begin = len(ranges)
            for phase in range(1 if looped else self._period):
                ranges.append([operation for sequel in own for operation in list_operations([sequel], phase)])
            faults = [operation for operation in ranges[begin] if isinstance(operation, EffectGroup)]
            loop = _Loop(wires, [instances[name] for name in order], faults) if looped else None
            self._groups.append((range(begin, len(ranges)), loop))
        self.histories: list[InputHistory] = [s.history for s in sequels if s.history is not None]
        self.memories: list[Stateful] = [
            *self.histories, *(loop.solver for _, loop in self._groups if loop is not None)
        ]  # fmt: skip
        plan = Plan(tuple(map(tuple, ranges)), wires.step)
        self._laps = None if stopwatch is None else stopwatch.begin(plan)
        self._steps = CompiledLoop(plan, parts.rows, self._laps, is_led=True)
        self._ended: dict[int, SlaveEnded] = {}  # by the number of a range, at the end of the step
        for column in parts.run_columns.own:  # those of a loop that has been cut stay 0
            values, place = parts.rows.find_place(column.port)
            values[place] = 0.0

    def advance(self, times: Array, interrupted: c_int) -> None:
        """See :class:`..compiled.StepLoop`.  Raises :class:`ConvergenceError`, too."""
        steps = self._steps
        steps.prepare(times)
        for time in times.tolist():
            if interrupted:
                return
            began = perf_counter_ns()
            phase = round((time - self._start) / self._step) % self._period
            steps.run_range(0, time)
            for ranges, loop in self._groups:
                if loop is not None:
                    loop.solve(partial(self._run_range, ranges[0], time), time)
                else:
                    self._run_range(ranges[phase], time)
            self._rows.store_latest()
            if self._laps is not None:
                self._laps.note_step(perf_counter_ns() - began, time)
            for ended in self._ended.values():
                raise ended

    def _run_range(self, number: int, time: float) -> None:
        self._ended.pop(number, None)  # in a loop the FMUs have been set back
        try:
            self._steps.run_range(number, time)
        except SlaveEnded as ended:
            if not ends_at(ended, time + self._step, self._step):
                raise
            self._ended[number] = ended

    def count_rows(self) -> int:
        """See :class:`..compiled.StepLoop`."""
        return self._rows.filled


class _Loop:
    """The components of a loop, in the order of stepping, the values that go back in it, and what faults do in it."""

    def __init__(
        self,
        wires: Wires,
        members: Sequence[FmuInstance],
        faults: Sequence[EffectGroup],
    ) -> None:
        names = [member.name for member in members]
        rows, columns = wires.parts.rows, wires.parts.run_columns.own
        self._members, self._rows, self._step = members, rows, wires.step
        self._unknowns = [p for p in _list_returning(names, wires) if p in rows.real.places]
        self._places = np.array([rows.real.places[port] for port in self._unknowns], dtype=np.intp)
        by_name = {member.name: member for member in members}
        nominal = [by_name[port.component].get_nominal(port.variable) for port in self._unknowns]
        self.solver = InterfaceSolver(wires.parts.scheme.iteration, np.array(nominal))
        self._faults = faults
        exact = all(member.derives for member in members) and not faults  # those are not in the derivatives of FMUs
        self._links: list[Link] | None = list_links(members, wires) if exact else None
        own = {column.kind: column for column in columns if set(column.members) == set(names)}
        self._columns = [rows.find_place(own[kind].port) for kind in ("passes", "residual") if kind in own]

    def solve(self, step: Callable[[], None], time: float) -> None:
        """Step from ``time`` [s] on, by ``step``.  Raises :class:`ConvergenceError` or :class:`SlaveError`."""
        rows, places = self._rows, self._places
        before, states, at_start = rows.latest.copy(), keep_states(self._members), True
        remembered = [group.keep() for group in self._faults]
        try:

            def evaluate(z: Array) -> Array:
                nonlocal at_start
                if not at_start:
                    for member, state in states.items():
                        member.set_state(state)
                    rows.latest[:] = before
                    for group, kept in zip(self._faults, remembered, strict=True):
                        group.restore(kept)
                at_start = False
                rows.real.values[places] = z
                step()
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
