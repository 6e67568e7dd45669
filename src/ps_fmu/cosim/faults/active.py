"""The faults of a run at work: which effects are in the exchange now, and what they remember."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from math import sqrt
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from ..checkpoint.state import State, copy_into
from ..clock import StepClock
from ..fmu_instance import FmuInstance
from ..rows import Array, Latest
from ..schemes.scheme import Scheme
from ..structure import PortName, System
from ..values import Value
from . import effects
from .binding import ActedFault, BoundFaults, Fault, bind_faults, identify, list_acted
from .effects import Effect, EffectGroup, Samples
from .reading import BIAS, DELAY, DROPOUT, NOISE, OVERRIDE, SCALE, FaultFile

Memories = list[tuple[Effect, Array]]
_BASES = {"Real": float, "Integer": int, "Enumeration": int, "Boolean": bool, "String": str}


def make_faults(
    file: FaultFile | None,
    system: System,
    descriptions: Mapping[str, ModelDescription],
    clock: StepClock,
    scheme: Scheme,
) -> ActiveFaults:
    """The faults of a file at work in a system.

    Raises :class:`SystemFileError`, see :func:`.binding.bind_faults`.
    """
    return ActiveFaults(None if file is None else bind_faults(file, system, descriptions, clock), clock, scheme)


class ActiveFaults:
    """The faults that act, by the inputs and parameters that see them.

    One that is connected gets them in the exchange of each step.  Another one has a ``base``, the value that it would
    have without faults: what they make of it is set once, or in each step where it changes.

    A component that makes a step in several of the base sees faults begin and end where its own steps begin.

    Parameters
    ----------
    bound: None for a run without faults
    clock: of the whole steps
    scheme: as resolved for the system
    """

    def __init__(self, bound: BoundFaults | None, clock: StepClock, scheme: Scheme) -> None:
        self.bound, self._clock, self._scheme = bound, clock, scheme
        self._faults = () if bound is None else bound.faults
        self._points = self._list_points()
        self.reset()

    def _list_points(self) -> list[int]:
        """The communication points where a fault begins or ends, at an input of a slow component at that one's own."""
        return sorted(
            -(-point // size) * size
            for fault in self._faults
            for size in {self._count_steps(port) for port in fault.inputs}
            for point in (fault.first, fault.last)
            if point is not None
        )

    def _count_steps(self, port: PortName) -> int:
        """Base steps in a step of the component of an input or parameter."""
        return self._scheme.get_rate(port.component).steps

    @property
    def recorded(self) -> list[PortName]:
        """Inputs and parameters that see a fault at some time: what they get is recorded."""
        return [] if self.bound is None else [*self.bound.types]

    def change(self, bound: BoundFaults) -> None:
        """Before the run: have the same events with other numbers."""
        self.bound, self._faults = bound, bound.faults
        self._points = self._list_points()
        self.reset()

    def reset(self) -> None:
        """Back to before the run."""
        self._acting: tuple[tuple[Fault, PortName], ...] = ()
        self._effects: dict[tuple[Fault, PortName], Effect] = {}
        self._bases: dict[PortName, Value] = {}
        self._open: set[PortName] = set()
        self._index = 0

    def find_change(self, index: int, end: int) -> int:
        """The first communication point after ``index`` where a fault begins or ends; ``end`` if that is before."""
        return min((point for point in self._points if index < point < end), default=end)

    def switch(self, index: int) -> bool:
        """Be at a communication point; whether other faults act now than before."""
        self._index = index
        if not self._faults:
            return False
        acting = tuple(
            (fault, port)
            for fault in self._faults
            for port in fault.inputs
            if fault.acts_at(index - index % self._count_steps(port))
        )
        changed, self._acting = acting != self._acting, acting
        self._effects = {key: effect for key, effect in self._effects.items() if key in acting}
        return changed

    @property
    def remarks(self) -> tuple[str, ...]:
        """What the file says in vain."""
        return () if self.bound is None else self.bound.remarks

    def check_end(self, duration: float) -> None:
        """Raises :class:`SystemFileError` for a fault that begins after the end of a run of a duration [s]."""
        if self.bound is not None:
            self.bound.check_end(self._clock, self._clock.steps(duration))

    def list_acted(self, time: float) -> tuple[ActedFault, ...]:
        """What acts in a step before a time [s]."""
        return list_acted(self._faults, self._clock, time)

    def identify(self) -> list[str]:
        """What has to be the same for a state of these faults to fit."""
        return [identify(fault, self._clock) for fault in self._faults]

    def save_state(self) -> dict[str, State]:
        """The values that were there without faults, and what the effects that have begun remember."""
        places = {fault: place for place, fault in enumerate(self._faults)}
        return {
            "index": self._index,
            "bases": {str(port): base for port, base in self._bases.items()},
            "memories": [
                {"fault": places[fault], "input": str(port), "memory": effect.memory.copy()}
                for (fault, port), effect in self._effects.items()
                if effect.has_begun
            ],
        }

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over a state of the same faults; :meth:`settle` has to follow.

        Raises ValueError, KeyError or IndexError: no such.
        """
        index = int(state["index"])
        if index < 0:
            raise ValueError(f"faults at the communication point {index}")
        self.reset()
        self.switch(index)
        ports = {str(port): port for port in self.recorded}
        for name, base in state["bases"].items():
            port, found = ports[name], type(base)
            if found is not _BASES[self._type(port)]:
                raise ValueError(f"{name} has the value {base!r} without faults")
            self._bases[port] = base
        for kept in state["memories"]:
            fault, port = self._faults[int(kept["fault"])], ports[kept["input"]]
            if (fault, port) not in self._acting:
                raise ValueError(f"the fault {fault.event.key} does not act on {port}")
            effect = self._find_effect(fault, port)
            copy_into(effect.memory, kept["memory"])
            effect.check_memory()

    def note(self, port: PortName, value: Value) -> bool:
        """An input or parameter gets another value from outside; whether faults act on it."""
        if port in self._bases:
            self._bases[port] = value
        return self.acts_on(port)

    def settle(self, instances: Mapping[str, FmuInstance], fed: Collection[PortName]) -> None:
        """Set what does not go with the exchange; ``fed`` are the inputs that do.  Raises :class:`SlaveError`."""
        seen = list(dict.fromkeys(port for fault, port in self._acting if not fault.on_output or port in fed))
        self._open = {port for port in seen if port not in fed}
        time = self._clock.time(self._index)
        for port in [port for port in self._bases if port not in self._open]:
            base = self._bases.pop(port)
            if port not in fed:
                instances[port.component].set({port.variable: base}, time)
        for port in seen:
            instance = instances[port.component]
            if port in self._open and port not in self._bases:
                self._bases[port] = instance.get([port.variable], time)[port.variable]
            if self._type(port) == "String":
                texts = [fault.value for fault in self._list_on(port) if fault.event.action == OVERRIDE]
                if texts:
                    instance.set({port.variable: str(texts[-1])}, time)
            elif port in self._open and not self._varies(port):
                instance.set({port.variable: self._change(port)}, time)

    def acts_on(self, port: PortName) -> bool:
        """Whether an input sees a fault now."""
        return any(port == seen for _, seen in self._acting)

    def find_cut(self) -> set[PortName]:
        """Connected Strings that faults keep from their sources."""
        return {port for _, port in self._acting if self._type(port) == "String"}

    def find_bases(self) -> dict[PortName, PortName]:
        """The sources of inputs and parameters that are not connected, and that faults change in each step."""
        varying = (port for port in self._open if self._type(port) != "String" and self._varies(port))
        # No name in a file has a NUL character.
        return {port: PortName("", f"\0{port}") for port in sorted(varying)}

    def make_bases(self) -> tuple[Latest, ...]:
        """The values of these sources, Reals and others."""
        found = []
        for is_real, kind in ((True, np.float64), (False, np.int32)):
            bases = {port: base for port, base in self.find_bases().items() if (self._type(port) == "Real") == is_real}
            values = np.array([self._bases[port] for port in bases], dtype=kind)
            found.append(Latest({base: place for place, base in enumerate(bases.values())}, values))
        return tuple(found)

    def make_group(
        self,
        wired: Sequence[PortName],
        inputs: NDArray[Any],
        on_output: bool,
    ) -> EffectGroup | None:
        """The effects on wired inputs, whose numbers are in ``inputs`` in that order; None where there are none.

        ``on_output``: those that come before the conversion for the input; else those behind it.
        """
        found = [
            (place, self._find_effect(fault, port))
            for place, port in enumerate(wired if self._acting else ())
            for fault in self._list_on(port)
            if fault.on_output == on_output
        ]
        return EffectGroup(inputs, found, self._clock) if found else None

    def keep(self) -> Memories:
        """What the effects remember, to be given back to :meth:`restore`."""
        return [(effect, effect.memory.copy()) for effect in self._effects.values()]

    def restore(self, memories: Memories) -> None:
        """Let the effects remember what they did."""
        for effect in self._effects.values():
            effect.forget()
        for effect, memory in memories:
            effect.memory[:] = memory

    def _type(self, port: PortName) -> str:
        assert self.bound is not None
        return self.bound.types[port]

    def _list_on(self, port: PortName) -> list[Fault]:
        """The faults that an input sees: of the output for all, of it for this input, of the input itself."""
        found = [f for f, seen in self._acting if port == seen and not (f.on_output and port in self._open)]
        return sorted(found, key=lambda fault: (not fault.on_output, fault.event.target is not None))

    def _varies(self, port: PortName) -> bool:
        """Whether what faults make of a constant changes with time."""
        return not all(self._find_effect(fault, port).is_constant for fault in self._list_on(port))

    def _change(self, port: PortName) -> Value:
        """What faults make of the base of an input or parameter, where that is constant."""
        base = self._bases[port]
        value: Array | NDArray[np.int32]
        value = np.array([base], np.float64) if isinstance(base, float) else np.array([base], np.int32)
        effects = [(0, self._find_effect(fault, port)) for fault in self._list_on(port)]
        EffectGroup(value, effects, self._clock).change_once(self._index)
        return type(base)(value[0])

    def _find_effect(self, fault: Fault, port: PortName) -> Effect:
        key = fault, port
        if key not in self._effects:
            self._effects[key] = _make_effect(fault, self._clock.step)
        return self._effects[key]


def _make_effect(fault: Fault, step: float) -> Effect:
    """The effect of a fault on the numbers that one input gets."""
    event, value = fault.event, fault.value
    number = float(value) if isinstance(value, bool | int | float) else 0.0
    if event.action == DELAY and fault.delay_steps == 0:
        return Effect(effects.BIAS)
    if event.action == DELAY:
        return Effect(effects.DELAY, length=fault.delay_steps)
    if event.action == NOISE:
        # The samples of white noise of a one-sided density S, one a step, have the variance S / (2 step).
        rms = event.rms if event.rms is not None else sqrt((event.density or 0.0) / (2.0 * step))
        return Effect(effects.ADD, draw=_scale(Samples(event.seed, _name(fault), normal=True), rms))
    if event.action == DROPOUT and event.probability < 1.0:
        draw = _compare(Samples(event.seed, _name(fault), normal=False), event.probability)
        return Effect(effects.HOLD if value is None else effects.REPLACE_LOST, number, draw=draw)
    kinds = {OVERRIDE: effects.OVERRIDE, BIAS: effects.BIAS, SCALE: effects.SCALE}
    kind = kinds.get(event.action, effects.HOLD if value is None else effects.OVERRIDE)
    return Effect(kind, number)


def _name(fault: Fault) -> str:
    """What tells the numbers of faults with one seed apart; all inputs that see a fault see the same."""
    return f"{fault.event.action} {fault.signal} {fault.event.target or ''}"


def _scale(samples: Samples, factor: float) -> Callable[[int, int], Array]:
    return lambda first, count: samples.draw(first, count) * factor


def _compare(samples: Samples, probability: float) -> Callable[[int, int], Array]:
    return lambda first, count: (samples.draw(first, count) < probability).astype(np.float64)
