"""Plans of schemes: components with rates of their own, and inputs that go on between two communication points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from ctypes import c_double
from dataclasses import dataclass, field, replace

import numpy as np
from fmpy.model_description import ModelDescription

from ..faults.effects import EffectGroup
from ..fmu_instance import FmuInstance
from ..plan import Call, Change, Gather, Move, Plan, Span, Stage
from ..rows import Rows
from ..wires import Wires, make_derivatives, make_step
from .history import Extension, Grid, InputHistory
from .lines import LineEnd, LineStart
from .resolving import find_period
from .scheme import Rate, Scheme


@dataclass(frozen=True)
class Setting:
    """What all parts of a plan share.

    ``start`` [s] is that of the simulation, ``step`` [s] the base step; ``descriptions`` those of the FMUs.
    """

    scheme: Scheme
    descriptions: Mapping[str, ModelDescription]
    wires: Wires
    rows: Rows
    start: float
    step: float
    now: c_double = field(default_factory=c_double)


Gathered = Gather | EffectGroup | Change


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


def make_sequel(setting: Setting, instance: FmuInstance, stepped_before: Sequence[str]) -> Sequel:
    """The step of one component.  ``stepped_before``: components whose outputs are those at the end of the step."""
    scheme, h = setting.scheme, setting.step
    rate = scheme.get_rate(instance.name)
    found, sets, gets = setting.wires.make_exchange([instance], setting.rows)
    length = rate.steps * h / rate.parts
    # A longer step is made in the last of its base steps, so that no FMU is ahead of the others.
    offsets = [k * length - (rate.steps - 1) * h for k in range(rate.parts)]
    plain = rate == Rate()
    spans = [None if plain else Span(offset, length) for offset in offsets]
    calls = [make_step(instance, setting.now, h, span) for span in spans]
    moves = tuple(setting.wires.list_moves([instance]))
    reals = [part for part in found if isinstance(part, Gather) and part.outputs is setting.rows.real.values]
    faulty = rate.steps > 1 and any(isinstance(part, EffectGroup) for part in found)
    extend = None if not reals or scheme.extrapolation == "hold" else _Extender(
        setting, instance, reals[0], stepped_before
    )  # fmt: skip
    if extend is None or not extend.continuous:
        first = Part(tuple(found), moves, tuple(sets), calls[0])
        rest = (Part((), (), (), call) for call in calls[1:])
        return Sequel(rate, (first, *rest), tuple(gets), None, tuple(found) if faulty else ())
    others = [part for part in found if isinstance(part, Change) or part.inputs is not reals[0].inputs]
    parts = []
    for k, call in enumerate(calls):
        gathered = extend.extend(k * length, length)
        if k == 0:
            parts.append(Part((*gathered, *others), moves, (*sets, *extend.calls), call))
        else:
            again = tuple(c for c in sets if c.function == "fmi2SetReal")
            parts.append(Part(gathered, (), (*again, *extend.calls), call))
    between = (*extend.begin, *others) if faulty else ()
    return Sequel(rate, tuple(parts), tuple(gets), extend.history, between)


class _Extender:
    """The inputs of a component that go on between two communication points."""

    def __init__(
        self, setting: Setting, instance: FmuInstance, gather: Gather, stepped_before: Sequence[str]
    ) -> None:
        scheme, rate = setting.scheme, setting.scheme.get_rate(instance.name)
        self._gather = gather = replace(gather, convert=None)
        names = [port.variable for port in gather.targets]
        # Real variables are continuous unless they say otherwise (FMI 2.0.4, section 2.2.7).
        kinds = [instance.variables[name].variability for name in names]
        self.places = np.array([k for k, kind in enumerate(kinds) if kind in (None, "continuous")], dtype=np.intp)
        self.continuous = len(self.places) > 0
        if not self.continuous:
            return
        sources = [setting.wires.sources[gather.targets[k]].component for k in self.places]
        gather.apply()
        self.history = InputHistory(
            Grid(setting.now, setting.start, setting.step),
            rate.steps * setting.step,
            scheme.extrapolation == "smoothed",
            gather.inputs[self.places],
            [scheme.get_rate(source).steps for source in sources],
            [int(source in stepped_before) for source in sources],
        )
        self._derivatives = None
        self.calls: tuple[Call, ...] = ()
        if setting.descriptions[instance.name].coSimulation.canInterpolateInputs:
            self._derivatives = np.zeros(len(self.places))
            self.calls = (make_derivatives(instance, [names[k] for k in self.places], self._derivatives),)
        self._line, self._slopes = np.zeros(len(self.places)), np.zeros(len(names))
        self.begin = self._change_lines(setting, rate)
        """What finds the lines where a base step begins, and changes them; nothing where lines stay as they are."""

    def _change_lines(self, setting: Setting, rate: Rate) -> tuple[Gathered, ...]:
        wires, gather, slopes = setting.wires, self._gather, self._slopes
        convert = wires.make_conversion(gather.targets, gather.inputs, slopes)
        before, after = wires.make_groups(gather.targets, gather.inputs, convert, (slopes, setting.step))
        if convert is None and not before and not after:
            return ()
        start = LineStart(self.history, gather.inputs, slopes, self.places, rate.steps)
        converted = [] if convert is None or before else [Change(convert)]
        return (gather, start.make_change(), *before, *converted, *after)

    def extend(self, offset: float, length: float) -> tuple[Gathered, ...]:
        """The inputs of a part that begins ``offset`` after the step and is ``length`` long [s]."""
        gather = self._gather
        if not self.begin:
            extension = Extension(self.history, gather.inputs, self.places, offset, length, self._derivatives)
            return (replace(gather, extension=extension),)
        shift = offset + 0.5 * length if self._derivatives is None else offset
        first = offset == 0.0
        end = LineEnd(self._line, gather.inputs, self._slopes, self.places, first, shift, self._derivatives)
        return (*(self.begin if first else ()), end.make_change())


def make_stages(sequels: Sequence[Sequel], phase: int = 0) -> list[Stage]:
    """What some components do together in a base step: all see the same outputs."""
    beginning = [s for s in sequels if phase % s.rate.steps == 0]
    ending = [s for s in sequels if (phase + 1) % s.rate.steps == 0]
    gathers = tuple(part for s in sequels for part in (s.between if phase % s.rate.steps else s.parts[0].gathers))
    moves = tuple(move for s in beginning for move in s.parts[0].moves)
    calls = [call for s in beginning for call in s.parts[0].sets] + [s.parts[0].step for s in ending]
    stages = [Stage(gathers, tuple(calls), moves)]
    stages += [Stage(p.gathers, (*p.sets, p.step), p.moves) for s in ending for p in s.parts[1:]]
    gets = tuple(call for s in ending for call in s.gets)
    stages[-1] = replace(stages[-1], calls=(*stages[-1].calls, *gets))
    return [stage for stage in stages if stage.gathers or stage.calls or stage.moves]


def make_scheme_plan(
    setting: Setting, instances: Mapping[str, FmuInstance], stepping: Sequence[str]
) -> tuple[Plan, list[InputHistory]]:
    """Plan of a scheme that is not iterated, and the histories of its inputs.

    Parameters
    ----------
    instances: loaded FMUs by component
    stepping: the components in the order of Gauss-Seidel
    """
    jacobi = setting.scheme.order == "jacobi"
    order = list(instances) if jacobi else list(stepping)
    sequels = [
        make_sequel(setting, instances[name], () if jacobi else order[:place]) for place, name in enumerate(order)
    ]
    groups = [sequels] if jacobi else [[sequel] for sequel in sequels]
    phases = [
        [stage for group in groups for stage in make_stages(group, phase)]
        for phase in range(find_period(setting.scheme))
    ]
    stages = tuple(stage for phase in phases for stage in phase)
    sizes = tuple(len(phase) for phase in phases)
    histories = [sequel.history for sequel in sequels if sequel.history is not None]
    signals = tuple(setting.wires.signals)
    plan = Plan(stages, setting.now, setting.step, signals, sizes, setting.start, tuple(histories))
    return plan, histories
