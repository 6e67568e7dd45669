"""Runs that diverge: how their motion grows, and what the poles of their loops say, before what an FMU complains of."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column, CosimError, UsageError, Value
from ..cosim.recording.delivery import read_rows
from ..interface.linear_system import MOST_GAIN_DB, Circuit, Reserve
from ..interface.system_model import LinearModelError, read_model
from ..mechanism.quantities import Complex, ParameterError
from ..pointing.response import find_growth
from ..results.datasets import open_results
from ..theory.stability import describe_unstable
from .options import RESULTS, RunOptions
from .stored_rows import make_stored_names
from .system import RunSystem

Array = NDArray[np.float64]

USELESS = 1e100  # in any unit; beyond its square statistics would overflow, and none of it is motion of a spacecraft
ROTATION = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")
FAR_RAD = 0.01  # a thousand times what the payload turns without the isolator
#: What grows in an unstable loop, as far as it is stored.  Rotations are last: large ones grow with the square.
WATCHED = (
    *(f"{one}_{leg}" for one in ("plant.fine_displacement", "isolator.fine_force") for leg in (1, 2, 3)),
    *ROTATION,
)
LEAST_GAIN_DB = 6.0  # of a margin
_UNUSABLE = ParameterError, UsageError, KeyError, np.linalg.LinAlgError
_NO_ANSWER = LinearModelError, *_UNUSABLE
ISOLATED, POINTED = "isolator.enabled", "pointing.enabled"


class Divergence(CosimError):
    """A motion that has grown without limit, as in an unstable loop.

    ``time``: s since the start of the simulation, when it was too large; rows after it tell nothing of the growth.
    """

    def __init__(self, text: str, time: float = math.inf) -> None:
        super().__init__(text)
        self.time = time


@dataclass(frozen=True)
class Bounds:
    """Observer that ends a run by :class:`Divergence` when a value exceeds :data:`USELESS`."""

    columns: tuple[Column, ...]
    ignored_magnitude: float = USELESS  # so that other blocks are not handed over

    def save_state(self) -> dict[str, object]:
        """Nothing: each block is looked at by itself."""
        return {}

    def load_state(self, state: Mapping[str, object]) -> None:
        """As :meth:`save_state`."""

    def block(self, _first_index: int, time: Array, values: Array) -> None:
        """Look at the rows (rows, columns); ``time`` (rows,) in s."""
        if max(values.max(), -values.min()) <= USELESS:
            return
        row, place = np.argwhere(np.abs(values) > USELESS)[0]
        column = self.columns[place]
        raise Divergence(
            f"{column.name} is beyond {USELESS:g} {column.unit or ''} at t = {time[row]:.9g} s: the motion grows "
            "without limit; look for an unstable loop (delay, light bus), or choose a smaller step"
        )


class Runaway:
    """Observer that ends a run by :class:`Divergence` when its payload turns far and its loops are unstable.

    Models of the plant that are made anew at each large motion would cost minutes, for numbers that mean nothing.

    Parameters
    ----------
    describe: what makes the loops unstable, empty for stable ones; asked once, when the payload has turned far.
    """

    def __init__(self, columns: Sequence[Column], describe: Callable[[], str]) -> None:
        self._places = [place for place, column in enumerate(columns) if column.name in ROTATION]
        self._describe = describe
        self._asked = not self._places

    def save_state(self) -> dict[str, object]:
        """Nothing: each block is looked at by itself."""
        return {}

    def load_state(self, state: Mapping[str, object]) -> None:
        """As :meth:`save_state`."""

    def block(self, _first_index: int, time: Array, values: Array) -> None:
        """Look at the rows (rows, columns); ``time`` (rows,) in s."""
        if self._asked or not len(values):
            return
        far = np.abs(values[:, self._places]).max(axis=1) > FAR_RAD
        if far.any():
            self._asked = True
            if self._describe():
                begin = float(time[far.argmax()])
                raise Divergence(f"the payload has turned by {1e3 * FAR_RAD:g} mrad at t = {begin:.4g} s", begin)

    early = block
    """Rows of an unfinished block: one that grows takes long in coming."""


class Growth(NamedTuple):
    """What grew exponentially at the end of a run."""

    name: str  # of the column
    rate: float  # 1/s
    frequency: float  # Hz; 0: it does not oscillate
    time: float  # s, of the last row

    def __str__(self) -> str:
        swing = f" at {self.frequency:.3g} Hz" if self.frequency else ""
        speed = f"by e in {1.0 / self.rate:.3g} s ({self.rate:+.3g} 1/s)"
        return f"{self.name} grows{swing} {speed} up to t = {self.time:.4g} s"


def explain_divergence(
    error: CosimError, system: RunSystem, options: RunOptions, case: str, values: Mapping[str, Value]
) -> Divergence | None:
    """The error of a run whose motion grew, or whose loops are unstable: that comes first; None: it is neither.

    ``values``: what the case sets, by ``component.variable``.
    """
    end = error.time if isinstance(error, Divergence) else math.inf
    end -= 2.0 * options.storage_s  # rows about it may be stored, or not
    rows = {name: (t[t <= end], found[t <= end]) for name, (t, found) in _read_watched(system, options, case).items()}
    growth, loop = _find_growth(rows), describe_loop(system, options, values)
    if growth is None and not loop:
        return None
    causes = [
        "the motion grows without limit" if growth is None else f"the motion grows without limit: {growth}",
        loop or _explain_stable(system, options, values),
    ]
    return Divergence(f"{case}: {'. '.join(cause[:1].upper() + cause[1:] for cause in causes)}.\nIt ended by: {error}")


def describe_loop(system: RunSystem, options: RunOptions, values: Mapping[str, Value]) -> str:
    """The unstable poles of the linear model, and what to turn; empty if it is stable, or there is none."""
    with suppress(*_NO_ANSWER):
        circuit = find_circuit(system, options, values)
        if circuit is not None and len(circuit.unstable):
            return f"the closed loop is unstable: {describe_unstable(circuit.unstable)}. {circuit.advise()}"
    return ""


def _explain_stable(system: RunSystem, options: RunOptions, values: Mapping[str, Value]) -> str:
    """Where else to look, if the linear model has no unstable loop, or does not include the system."""
    try:
        find_circuit(system, options, values)
    except LinearModelError as error:
        return f"the poles of the loop are unknown: {error}. Look for an unstable controller first"
    return "no loop of the linear model is unstable, so look for a limit, a fault or too long a step"


def find_circuit(system: RunSystem, options: RunOptions, values: Mapping[str, Value]) -> Circuit | None:
    """The linear model of a case, kept by ``system``; None: its isolator is off, or a value cannot be used.

    Raises LinearModelError: it does not include an FMU of the system, such as a controller of one's own.
    """
    on = {name: bool(values.get(name, _get_start(system, name))) for name in (ISOLATED, POINTED)}
    if not on[ISOLATED]:  # then nothing is closed, or a line-of-sight loop alone, of which there is no closed form
        return None
    key = options.step_s, *sorted(values.items())
    if key not in system.circuits:
        with suppress(*_UNUSABLE):
            model = read_model(system.structure.with_parameters(values), options.step_s)
            system.circuits[key] = Circuit(model if on[POINTED] else model.without_pointing(), active=True)
    return system.circuits.get(key)


@dataclass(frozen=True)
class LoopState:
    """Whether the closed loops of a case are stable in the linear model, and how far from instability."""

    unstable: Complex
    """Poles in the right half-plane, rad/s, the one farthest to the right first."""
    reserve: Reserve | None
    """None: unstable, or unknown."""
    unknown: str = ""
    """Why the poles are unknown; empty: they are known."""

    @property
    def text(self) -> str:
        """One sentence."""
        if self.unknown:
            return f"poles and margins of the loop are unknown: {self.unknown}."
        if len(self.unstable):
            return f"the linear model is UNSTABLE: {describe_unstable(self.unstable)}."
        if self.reserve is None:
            return "the linear model is stable."
        small = f" Less than {LEAST_GAIN_DB:g} dB is little." if abs(self.reserve.gain_db) < LEAST_GAIN_DB else ""
        return f"the linear model is stable: {self.reserve}.{small}"

    def as_dict(self) -> dict[str, object]:
        """The entry of summary.json."""
        near = self.reserve
        return {
            "stable": None if self.unknown else not len(self.unstable),
            "unstable_poles_rad_s": [[pole.real, pole.imag] for pole in self.unstable],
            "least_damped_pole_rad_s": None if near is None or near.pole is None else [near.pole.real, near.pole.imag],
            "frequency_hz": None if near is None else near.frequency_hz,
            "damping_ratio": None if near is None else near.damping_ratio,
            "gain_margin_db": None if near is None else min(abs(near.gain_db), MOST_GAIN_DB),
            "unknown": self.unknown,
            "gain_margins_db": {} if near is None else {name: gain for name, (gain, _) in near.gains.items()},
        }


def judge_loops(
    system: RunSystem, options: RunOptions, cases: Mapping[str, Mapping[str, Value]], thorough: bool = False
) -> dict[str, LoopState]:
    """The state of the loops of each case with a closed loop, by its name.

    ``cases``: what each sets, by ``component.variable``.  ``thorough``: also where that takes 0.2 s, unless it is known
    already: where a line-of-sight loop is closed, or the isolator's delay is long.
    """
    found = {}
    for name, values in cases.items():
        try:
            circuit = None if options.is_plain else find_circuit(system, options, values)
        except LinearModelError as error:
            found[name] = LoopState(np.zeros(0, dtype=complex), None, str(error))
            continue
        if circuit is None:
            continue
        costly = (circuit.closed or circuit.has_long_delay) and "unstable" not in vars(circuit)
        if thorough or not costly:
            with suppress(*_NO_ANSWER):
                found[name] = LoopState(circuit.unstable, circuit.reserve)
    return found


def _get_start(system: RunSystem, name: str) -> Value:
    with suppress(KeyError, UsageError):
        return system.get_start(name)
    return False


def _find_growth(columns: Mapping[str, tuple[Array, Array]]) -> Growth | None:
    """The growth of the first column that grows exponentially."""
    for name in (name for name in WATCHED if name in columns):
        time, values = columns[name]
        if (growth := find_growth(time, values)) is not None:
            return Growth(name, growth.rate, growth.frequency, float(time[-1]))
    return None


def _read_watched(system: RunSystem, options: RunOptions, case: str) -> dict[str, tuple[Array, Array]]:
    """Time and values of the rows that were kept of :data:`WATCHED`."""
    if system.kept is not None:
        rows = system.kept[case].rows
        return {
            column.name: (rows.time, np.asarray(rows.values[:, place], dtype=float))
            for place, column in enumerate(rows.columns)
            if column.name in WATCHED
        }
    stored = make_stored_names([column.name for column in system.columns])
    found = {}
    with suppress(OSError, KeyError), open_results(options.output / RESULTS) as file:
        group = file.groups[case]
        count = len(group.dimensions["time"])
        time = np.asarray(read_rows(group["time"], 0, count), dtype=float)
        for name in WATCHED:
            if stored.get(name) in group.variables:
                found[name] = time, np.asarray(read_rows(group[stored[name]], 0, count), dtype=float)
    return found
