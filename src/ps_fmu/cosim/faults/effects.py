"""What faults do to the numbers of an exchange.  ``native/effects.c`` does the same, to the last bit.

An effect has a memory, an array that both use; groups are prepared for some steps before these are made.  An input that
goes on along a line has a slope, too, which effects change with its value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from ctypes import POINTER, Structure, addressof, c_double, c_int64, c_void_p
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..clock import ON_GRID, StepClock
from ..rows import Array

# Kinds, as in effects.c.
OVERRIDE, BIAS, SCALE, ADD, REPLACE_LOST, HOLD, DELAY = range(7)
LOWEST, HIGHEST = -(2**31), 2**31 - 1
_MOST_STEPS = 2.0**53  # doubles have each whole number up to there
_BEGAN, _LAST, _FIRST = 0, 1, 2  # places in the memory: step of the first use, step of the last, what is held


@dataclass(eq=False)
class Effect:
    """What one fault does to the numbers that one input gets.

    OVERRIDE, BIAS and SCALE: ``value``.  ADD: the ``samples`` are added.  REPLACE_LOST: ``value`` where the sample of
    the step is not 0.  HOLD: what it was when this began, or in the last step whose sample is 0.  DELAY: what it was
    ``length`` steps ago, and until there is such a step, when this began.

    ``draw`` gives the samples of a step and those after it, for HOLD it may be None.  ``lined``: there are slopes to be
    remembered, too.
    """

    kind: int
    value: float = 0.0
    length: int = 0
    draw: Callable[[int, int], Array] | None = None
    lined: bool = False
    memory: Array = field(init=False)
    samples: Array | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.kind == BIAS and self.value == 0.0:
            self.value = -0.0  # v + 0.0 would turn -0.0 into 0.0
        self.memory = np.full(_FIRST + (self.length + 1) * (2 if self.lined else 1), -1.0)

    def forget(self) -> None:
        """Be as before the first use."""
        self.memory.fill(-1.0)

    @property
    def has_begun(self) -> bool:
        """Whether there is something in the memory."""
        return bool(self.memory[_BEGAN] >= 0.0)

    def check_memory(self) -> None:
        """Raises ValueError unless the steps in the memory, by which it is read, are whole numbers from 0 on."""
        began, last = self.memory[_BEGAN], self.memory[_LAST]
        if not (began.is_integer() and 0.0 <= began < _MOST_STEPS and last.is_integer() and -1.0 <= last < _MOST_STEPS):
            raise ValueError(f"an effect from step {began} to {last}")

    @property
    def is_constant(self) -> bool:
        """Whether a constant stays one behind it."""
        return self.draw is None and self.kind != DELAY

    def change(self, number: float, step: int, row: int) -> float:
        """The number behind the effect in a ``step``, whose samples are in ``row``."""
        memory, samples = self.memory, self.samples
        if self.kind == OVERRIDE:
            return self.value
        if self.kind == BIAS:
            return number + self.value
        if self.kind == SCALE:
            return number * self.value
        if self.kind == ADD:
            assert samples is not None
            return number + float(samples[row])
        if self.kind == REPLACE_LOST:
            assert samples is not None
            return self.value if samples[row] else number
        begins = memory[_BEGAN] < 0.0
        if begins:
            memory[_BEGAN] = step
        if self.kind == HOLD:
            if begins or (samples is not None and not samples[row]):
                memory[_FIRST] = number
            return float(memory[_FIRST])
        size = self.length + 1
        if memory[_LAST] < step:  # no part of a step that is repeated in smaller ones
            memory[_LAST] = step
            memory[_FIRST + step % size] = number
        return float(memory[_FIRST + max(step - self.length, int(memory[_BEGAN])) % size])

    def change_line(self, line: tuple[float, float], step: int, row: int, part: StepPart) -> tuple[float, float]:
        """Value and slope [1/s] behind the effect.  As :meth:`change`, if the slope is 0.

        What is held stays where the line was last, and the line of a delay is that of the step so long ago.
        """
        number, slope = line
        if self.kind == HOLD:
            return self._hold_line(number, slope, step, row, part)
        if self.kind == DELAY:
            return self._delay_line(number, slope, step, part)
        changed = self.change(number, step, row)
        if self.kind == SCALE:
            return changed, slope * self.value
        if self.kind == OVERRIDE or (self.kind == REPLACE_LOST and self.samples is not None and self.samples[row]):
            return changed, 0.0
        return changed, slope

    def _hold_line(self, number: float, slope: float, step: int, row: int, part: StepPart) -> tuple[float, float]:
        memory, comes = self.memory, self.samples is not None and not self.samples[row]
        begins = memory[_BEGAN] < 0.0
        if begins:
            memory[_BEGAN] = step
        if comes:
            memory[_FIRST] = number + slope * part.length if slope else number
            return number, slope
        if begins:
            memory[_FIRST] = number
        return float(memory[_FIRST]), 0.0

    def _delay_line(self, number: float, slope: float, step: int, part: StepPart) -> tuple[float, float]:
        memory, size = self.memory, self.length + 1
        if memory[_BEGAN] < 0.0:
            memory[_BEGAN] = step
        if memory[_LAST] < step:
            memory[_LAST] = step
            memory[_FIRST + step % size], memory[_FIRST + size + step % size] = number, slope
        if step - self.length < memory[_BEGAN]:
            return float(memory[_FIRST + int(memory[_BEGAN]) % size]), 0.0
        place = (step - self.length) % size
        value, slope = float(memory[_FIRST + place]), float(memory[_FIRST + size + place])
        return value + slope * part.begin if part.begin else value, slope


@dataclass(frozen=True)
class StepPart:
    """The part of a whole step that begins ``begin`` after it, and is ``length`` long [s]."""

    begin: float = 0.0
    length: float = 0.0


class _Effect(Structure):
    """``Effect`` of effects.c."""

    _fields_ = (
        ("kind", c_int64),
        ("place", c_int64),
        ("length", c_int64),
        ("value", c_double),
        ("memory", c_void_p),
        ("samples", c_void_p),
    )


class _Group(Structure):
    """``Effects`` of effects.c."""

    _fields_ = (
        ("effects", POINTER(_Effect)),
        *((name, c_int64) for name in ("count", "step", "row")),
        ("slopes", c_void_p),
        *((name, c_double) for name in ("begin", "length")),
    )


class EffectGroup:
    """The effects on an array of inputs, in their order: a part of the exchange.

    Parameters
    ----------
    inputs: doubles or C ints, changed in place
    effects: with the place that each changes
    clock: of the whole steps
    convert: changes all inputs behind them, where they have other units or transformations
    lines: for inputs that go on along lines, their slopes [1/s], changed in place, and how long the lines are [s]
    """

    def __init__(
        self,
        inputs: NDArray[np.float64] | NDArray[np.int32],
        effects: Sequence[tuple[int, Effect]],
        clock: StepClock,
        convert: Callable[[], None] | None = None,
        lines: tuple[Array, float] | None = None,
    ) -> None:
        self.inputs, self.convert = inputs, convert
        self._lines = lines
        self._part = StepPart() if lines is None else StepPart(length=lines[1])
        self._samples: list[Array] = []  # the structure below has their addresses
        self._effects, self._clock = tuple(effects), clock
        self._native = (_Effect * len(effects))(
            *(_Effect(e.kind, place, e.length, e.value, e.memory.ctypes.data) for place, e in effects)
        )
        slopes = None if lines is None else lines[0].ctypes.data
        self._group = _Group(self._native, len(effects), 0, 0, slopes, 0.0, self._part.length)
        self._discrete = inputs.dtype != np.float64

    @property
    def needs_python(self) -> bool:
        """Whether effects.c cannot do it."""
        return self.convert is not None

    @property
    def has_lines(self) -> bool:
        """Whether it changes slopes, too."""
        return self._lines is not None

    @property
    def count(self) -> int:
        """How many effects there are."""
        return len(self._effects)

    @property
    def address(self) -> int:
        """Of the structure that effects.c takes."""
        return addressof(self._group)

    def prepare(self, times: Array) -> None:
        """Be ready for a step from each of the ``times`` [s]: the samples are drawn."""
        if not len(times):
            return
        first = find_step(self._clock, float(times[0]))
        self._group.step, self._group.row = first, 0
        if self._lines is not None:
            late = float(times[0]) - self._clock.time(first)
            self._group.begin = late if late > ON_GRID * self._clock.step else 0.0
            self._part = StepPart(self._group.begin, self._lines[1])
        self._samples.clear()
        for (_, effect), native in zip(self._effects, self._native, strict=True):
            if effect.draw is not None:
                effect.samples = effect.draw(first, len(times))
                self._samples.append(effect.samples)
                native.samples = effect.samples.ctypes.data

    def apply(self) -> None:
        """Change the inputs of the next step, and convert them."""
        group, inputs = self._group, self.inputs
        step, row = group.step, group.row
        if self._lines is not None:
            slopes = self._lines[0]
            for place, effect in self._effects:
                line = float(inputs[place]), float(slopes[place])
                inputs[place], slopes[place] = effect.change_line(line, step, row, self._part)
        else:
            for place, effect in self._effects:
                number = effect.change(float(inputs[place]), step, row)
                inputs[place] = to_int(number) if self._discrete else number
        group.step, group.row = step + 1, row + 1
        if self.convert is not None:
            self.convert()

    def list_changes(self) -> list[Callable[[], None]]:
        """As :meth:`.plan.Gather.list_changes`."""
        return [self.apply]

    def keep(self) -> tuple[int, int, list[Array]]:
        """Where it is, and what its effects remember, for :meth:`restore`."""
        return self._group.step, self._group.row, [effect.memory.copy() for _, effect in self._effects]

    def restore(self, kept: tuple[int, int, list[Array]]) -> None:
        """Go back to there, to make the same step again."""
        self._group.step, self._group.row, memories = kept
        for (_, effect), memory in zip(self._effects, memories, strict=True):
            effect.memory[:] = memory


def to_int(number: float) -> int:
    """A number within the C ints."""
    return LOWEST if math.isnan(number) else int(min(max(number, LOWEST), HIGHEST))


def find_step(clock: StepClock, time: float) -> int:
    """The whole step that a time [s] lies in: of a part of a step, the step that is divided."""
    ratio = (time - clock.start) / clock.step
    near = round(ratio)
    rounding = 2.0 * math.ulp(max(abs(time), abs(clock.start), clock.step))
    return near if abs(clock.time(near) - time) <= rounding else math.floor(ratio)
