"""What faults do to the numbers of an exchange, in ``native/effects.c``.

An effect has a memory, an array; groups are prepared for some steps before these are made.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Sequence
from ctypes import POINTER, Structure, addressof, byref, c_double, c_int64, c_void_p
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ..clock import StepClock
from ..guard import load_library
from ..rows import Array

BLOCK = 1024
"""Steps whose numbers are drawn together: 15 us."""


class Samples:
    """Numbers of the steps: standard normal, or uniform in [0, 1).

    Parameters
    ----------
    seed: not negative
    name: of the signal and what the numbers are for: others have other numbers
    normal: which of the two
    """

    def __init__(self, seed: int, name: str, *, normal: bool) -> None:
        digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
        self._key = [int.from_bytes(digest[k : k + 8], "little") for k in (0, 8)]
        self._normal = normal
        self._block, self._numbers = -1, np.empty(0)

    def draw(self, first: int, count: int) -> Array:
        """The numbers of ``count`` steps from ``first`` on, (count,)."""
        parts = []
        while count > 0:
            block, place = divmod(first, BLOCK)
            part = self._draw_block(block)[place : place + count]
            parts.append(part)
            first, count = first + len(part), count - len(part)
        return np.concatenate(parts) if parts else np.empty(0)

    def _draw_block(self, block: int) -> Array:
        if block != self._block:
            generator = np.random.Generator(np.random.Philox(key=self._key, counter=[0, 0, block, 0]))
            draw: Callable[[int], Array] = generator.standard_normal if self._normal else generator.random
            self._block, self._numbers = block, draw(BLOCK)
        return self._numbers


# Kinds, as in effects.c.
OVERRIDE, BIAS, SCALE, ADD, REPLACE_LOST, HOLD, DELAY = range(7)
_MOST_STEPS = 2.0**53  # doubles have each whole number up to there
_BEGAN, _LAST, _FIRST = 0, 1, 2  # places in the memory: step of the first use, step of the last, what is held


@dataclass(eq=False)
class Effect:
    """What one fault does to the numbers that one input gets.

    OVERRIDE, BIAS and SCALE: ``value``.  ADD: the ``samples`` are added.  REPLACE_LOST: ``value`` where the sample of
    the step is not 0.  HOLD: what it was when this began, or in the last step whose sample is 0.  DELAY: what it was
    ``length`` steps ago, and until there is such a step, when this began.

    ``draw`` gives the samples of a step and those after it, for HOLD it may be None.
    """

    kind: int
    value: float = 0.0
    length: int = 0
    draw: Callable[[int, int], Array] | None = None
    memory: Array = field(init=False)
    samples: Array | None = field(init=False, default=None)

    def __post_init__(self) -> None:
        if self.kind == BIAS and self.value == 0.0:
            self.value = -0.0  # v + 0.0 would turn -0.0 into 0.0
        self.memory = np.full(_FIRST + self.length + 1, -1.0)

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
    )


class EffectGroup:
    """The effects on an array of inputs, in their order: a part of the exchange.

    Parameters
    ----------
    inputs: doubles or C ints, changed in place
    effects: with the place that each changes
    clock: of the whole steps
    """

    def __init__(
        self,
        inputs: NDArray[np.float64] | NDArray[np.int32],
        effects: Sequence[tuple[int, Effect]],
        clock: StepClock,
    ) -> None:
        self.inputs = inputs
        self._samples: list[Array] = []  # the structure below has their addresses
        self._effects, self._clock = tuple(effects), clock
        self._native = (_Effect * len(effects))(
            *(_Effect(e.kind, place, e.length, e.value, e.memory.ctypes.data) for place, e in effects)
        )
        self._group = _Group(self._native, len(effects), 0, 0)

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
        self._samples.clear()
        for (_, effect), native in zip(self._effects, self._native, strict=True):
            if effect.draw is not None:
                effect.samples = effect.draw(first, len(times))
                self._samples.append(effect.samples)
                native.samples = effect.samples.ctypes.data

    def change_once(self, step: int) -> None:
        """Change the inputs for a step, whose effects need no samples."""
        self._group.step = step
        library = load_library()
        change = library.change_ints if self.inputs.dtype == np.int32 else library.change_doubles
        change(byref(self._group), c_void_p(self.inputs.ctypes.data))

    def keep(self) -> tuple[int, int, list[Array]]:
        """Where it is, and what its effects remember, for :meth:`restore`."""
        return self._group.step, self._group.row, [effect.memory.copy() for _, effect in self._effects]

    def restore(self, kept: tuple[int, int, list[Array]]) -> None:
        """Go back to there, to make the same step again."""
        self._group.step, self._group.row, memories = kept
        for (_, effect), memory in zip(self._effects, memories, strict=True):
            effect.memory[:] = memory


def find_step(clock: StepClock, time: float) -> int:
    """The whole step that a time [s] lies in: of a part of a step, the step that is divided."""
    ratio = (time - clock.start) / clock.step
    near = round(ratio)
    rounding = 2.0 * math.ulp(max(abs(time), abs(clock.start), clock.step))
    return near if abs(clock.time(near) - time) <= rounding else math.floor(ratio)
