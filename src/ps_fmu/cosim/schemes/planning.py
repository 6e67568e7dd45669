"""The plan of the steps: components with rates of their own, and inputs that go on between two communication points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..faults.effects import EffectGroup
from ..fmu_instance import FmuInstance
from ..plan import Call, Change, Gather, Gathered, Move, Operation, Plan
from ..wires import Wires, make_derivatives, make_scale, make_step
from .history import InputHistory
from .resolving import find_period
from .scheme import Rate


@dataclass(frozen=True)
class Part:
    """A part of a component's step: what it needs before, and its fmi2DoStep."""

    gathers: tuple[Gathered, ...]
    moves: tuple[Move, ...]
    sets: tuple[Call, ...]
    step: Call


@dataclass(frozen=True)
class Sequel:
    """The parts of a component's step; the values of the first are set where it begins, it is made where it ends.

    ``between``: what faults see of the inputs in the base steps in which no step of the component begins.
    """

    rate: Rate
    parts: tuple[Part, ...]
    gets: tuple[Call, ...]
    history: InputHistory | None
    between: tuple[Gathered, ...]


def make_sequel(wires: Wires, instance: FmuInstance, stepped_before: Sequence[str]) -> Sequel:
    """The step of one component.  ``stepped_before``: components whose outputs are those at the end of the step."""
    scheme, h = wires.parts.scheme, wires.step
    rate = scheme.get_rate(instance.name)
    found, sets, gets = wires.make_exchange(instance)
    length = rate.steps * h / rate.parts
    # A longer step is made in the last of its base steps, so that no FMU is ahead of the others.
    offsets = [k * length - (rate.steps - 1) * h for k in range(rate.parts)]
    plain = rate == Rate()
    spans = [None if plain else np.array([offset, length]) for offset in offsets]
    calls = [make_step(instance, span) for span in spans]
    moves = tuple(wires.list_moves(instance))
    reals = [part for part in found if isinstance(part, Gather) and part.outputs is wires.parts.rows.real.values]
    faulty = rate.steps > 1 and any(isinstance(part, EffectGroup) for part in found)
    extend = None if not reals or scheme.extrapolation == "hold" else _Extender(
        wires, instance, reals[0], stepped_before
    )  # fmt: skip
    if extend is None or not extend.continuous:
        first = Part(tuple(found), moves, tuple(sets), calls[0])
        rest = (Part((), (), (), call) for call in calls[1:])
        return Sequel(rate, (first, *rest), tuple(gets), None, tuple(found) if faulty else ())
    begin = found.index(reals[0]) + 1
    parts = []
    for k, call in enumerate(calls):
        lines, scales = extend.extend(k * length, length)
        if k == 0:
            gathered = (*found[:begin], lines, *found[begin:], *extend.scale_slopes)
            parts.append(Part(gathered, moves, (*sets, *extend.calls), call))
        else:
            again = tuple(c for c in sets if c.function == "fmi2SetReal")
            parts.append(Part((lines, *scales, *extend.scale_slopes), (), (*again, *extend.calls), call))
    return Sequel(rate, tuple(parts), tuple(gets), extend.history, tuple(found) if faulty else ())


class _Extender:
    """The inputs of a component that go on between two communication points.

    One that sees a fault is held meanwhile; its history goes on.
    """

    def __init__(
        self, wires: Wires, instance: FmuInstance, gather: Gather, stepped_before: Sequence[str]
    ) -> None:
        scheme, faults = wires.parts.scheme, wires.faults
        self._gather, self._wires = gather, wires
        names = [port.variable for port in gather.targets]
        # Real variables are continuous unless they say otherwise (FMI 2.0.4, section 2.2.7).
        kinds = [instance.variables[name].variability for name in names]
        self._places = np.array([k for k, kind in enumerate(kinds) if kind in (None, "continuous")], dtype=np.intp)
        self.continuous = len(self._places) > 0
        if not self.continuous:
            return
        targets = [gather.targets[k] for k in self._places]
        self._held = np.array([faults.acts_on(port) for port in targets], dtype=np.int64)
        sources = [wires.sources[port].component for port in targets]
        self.history = InputHistory(
            (wires.parts.clock.start, wires.step, scheme.get_rate(instance.name).steps * wires.step),
            scheme.extrapolation == "smoothed",
            gather.outputs[gather.sources[self._places]],
            [scheme.get_rate(source).steps for source in sources],
            [int(source in stepped_before) for source in sources],
        )
        self._derivatives = None
        self.calls: tuple[Call, ...] = ()
        self.scale_slopes: tuple[Change, ...] = ()
        if wires.parts.descriptions[instance.name].coSimulation.canInterpolateInputs:
            self._derivatives = np.zeros(len(targets))
            self.calls = (make_derivatives(instance, [port.variable for port in targets], self._derivatives),)
            # v + 0.0 would turn -0.0 into 0.0.
            scales = [
                (k, wires.conversions[port].factor, -0.0) for k, port in enumerate(targets) if port in wires.conversions
            ]
            self.scale_slopes = (make_scale(self._derivatives, scales),) if scales else ()

    def extend(self, offset: float, length: float) -> tuple[Change, list[Change]]:
        """The inputs of a part that begins ``offset`` after the step and is ``length`` long [s]: lines, conversions."""
        inputs, places = self._gather.inputs, self._places
        change = self.history.extend(inputs, places, self._held, offset, length, self._derivatives)
        lined = set(places[self._held == 0].tolist())
        return change, self._wires.make_conversion(self._gather.targets, inputs, lined)


def list_operations(sequels: Sequence[Sequel], phase: int = 0) -> list[Operation]:
    """What some components do together in a base step: all see the same outputs."""
    beginning = [s for s in sequels if phase % s.rate.steps == 0]
    ending = [s for s in sequels if (phase + 1) % s.rate.steps == 0]
    found: list[Operation] = []
    for s in sequels:
        found += s.between if phase % s.rate.steps else s.parts[0].gathers
    for s in beginning:
        found += s.parts[0].moves
    for s in beginning:
        found += s.parts[0].sets
    found += [s.parts[0].step for s in ending]
    for part in (p for s in ending for p in s.parts[1:]):
        found += [*part.gathers, *part.sets, part.step]
    for s in ending:
        found += s.gets
    return found


def make_plan(wires: Wires) -> tuple[Plan, list[InputHistory]]:
    """Plan of a scheme that is not iterated, and the histories of its inputs."""
    parts = wires.parts
    jacobi = parts.scheme.order == "jacobi"
    order = list(parts.instances) if jacobi else list(parts.wiring.stepping)
    sequels = [
        make_sequel(wires, parts.instances[name], () if jacobi else order[:place]) for place, name in enumerate(order)
    ]
    groups = [sequels] if jacobi else [[sequel] for sequel in sequels]
    feeds = wires.make_feeds()
    ranges = tuple(
        (*(operation for group in groups for operation in list_operations(group, phase)), *feeds)
        for phase in range(find_period(parts.scheme))
    )
    histories = [sequel.history for sequel in sequels if sequel.history is not None]
    return Plan(ranges, wires.step, parts.clock.start, tuple(histories)), histories
