"""Where the time of the steps goes: each call of an FMU and each exchange, timed by the loop that runs them.

The loop reads the clock after each part of a step.  A reading takes about 25 ns and is within each figure.
"""

from __future__ import annotations

from collections.abc import Sequence
from ctypes import Structure, c_int64, c_void_p
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .plan import Call, Operation, Plan

EXCHANGE = "exchange"
"""What stands in place of a component's name where outputs are copied to inputs."""


@dataclass
class PartCost:
    """What one component, or the exchange, has cost: seconds of wall time."""

    set_s: float = 0.0
    """Setting inputs; of the exchange: copying from outputs to inputs."""
    step_s: float = 0.0
    get_s: float = 0.0
    longest_s: float = 0.0
    """Longest single call."""
    longest_at: float = float("nan")
    """Communication point where the step with that call began [s]."""

    @property
    def total_s(self) -> float:
        """All of it."""
        return self.set_s + self.step_s + self.get_s


@dataclass(frozen=True)
class StepCosts:
    """What the steps of a run have cost: seconds of wall time."""

    steps: int
    parts: dict[str, PartCost]
    """By component, in the order of stepping; the exchange is :data:`EXCHANGE`."""
    total_s: float
    """All steps, with the loop itself and the rows that it fills."""
    longest_s: float
    """Longest step."""
    longest_at: float
    """Communication point where it began [s]."""


class Timing(Structure):
    """``Timing`` of loop.c."""

    _fields_ = (
        ("spent_ns", c_void_p),
        ("longest_ns", c_void_p),
        ("longest_at", c_void_p),
        ("steps", c_int64),
        ("unfinished_ns", c_int64),
    )


Part = tuple[str, str]
"""Component and function of a call; :data:`EXCHANGE` and nothing for what is copied."""


@dataclass
class Laps:
    """The times of the parts of alike plans; the entry after the last part is the whole step."""

    parts: Sequence[Part]
    spent_ns: NDArray[np.int64] = field(init=False)
    longest_ns: NDArray[np.int64] = field(init=False)
    longest_at: NDArray[np.float64] = field(init=False)
    timing: Timing = field(init=False)

    def __post_init__(self) -> None:
        size = len(self.parts) + 1
        self.spent_ns, self.longest_ns = np.zeros(size, np.int64), np.zeros(size, np.int64)
        self.longest_at = np.full(size, np.nan)
        self.timing = Timing(*(a.ctypes.data for a in (self.spent_ns, self.longest_ns, self.longest_at)), 0, 0)

    def note_step(self, spent_ns: int, at: float) -> None:
        """Add what a whole step from ``at`` [s] on took, of those that Python leads."""
        self.timing.steps += 1
        self.spent_ns[-1] += spent_ns
        if spent_ns > self.longest_ns[-1]:
            self.longest_ns[-1], self.longest_at[-1] = spent_ns, at


class Stopwatch:
    """Times the steps of one run after the other: the loops of all their plans write into it.

    It keeps no plan.  Those of the same calls in the same order, as after each reset of a Master, share their place, so
    that it does not grow with their number.
    """

    def __init__(self) -> None:
        self._laps: dict[tuple[Part, ...], Laps] = {}

    def begin(self, plan: Plan) -> Laps:
        """Where the loop of a plan notes its times."""
        parts = tuple(map(_name_part, plan.operations))
        return self._laps.setdefault(parts, Laps(parts))

    def read(self) -> StepCosts:
        """What has been noted so far."""
        parts: dict[str, PartCost] = {}
        every = self._laps.values()
        for laps in every:
            for place, (name, function) in enumerate(laps.parts):
                _add(parts.setdefault(name, PartCost()), function, laps, place)
        whole = max(every, key=lambda laps: laps.longest_ns[-1], default=None)
        return StepCosts(
            steps=sum(laps.timing.steps for laps in every),
            parts=parts,
            total_s=sum(int(laps.spent_ns[-1]) for laps in every) * 1e-9,
            longest_s=0.0 if whole is None else float(whole.longest_ns[-1]) * 1e-9,
            longest_at=float("nan") if whole is None else float(whole.longest_at[-1]),
        )


def _name_part(part: Operation) -> Part:
    return (part.instance.name, part.function) if isinstance(part, Call) else (EXCHANGE, "")


def _add(cost: PartCost, function: str, laps: Laps, place: int) -> None:
    spent, longest = float(laps.spent_ns[place]) * 1e-9, float(laps.longest_ns[place]) * 1e-9
    if not function or function.startswith("fmi2Set"):
        cost.set_s += spent
    elif function.startswith("fmi2Get"):
        cost.get_s += spent
    else:
        cost.step_s += spent
    if longest > cost.longest_s:
        cost.longest_s, cost.longest_at = longest, float(laps.longest_at[place])
