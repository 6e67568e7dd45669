"""Runs that diverge: how their motion grows, and what the poles of their loops say, before what an FMU complains of."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column, CosimError, UsageError, Value
from ..cosim.recording.delivery import read_rows
from ..interface.linear_system import Circuit, LinearModelError, read_model
from ..mechanism.quantities import ParameterError
from ..pointing.response import find_growth
from ..results.datasets import open_results
from ..theory.stability import describe_unstable
from .options import RESULTS, RunOptions
from .setup import RunSystem
from .stored_rows import make_stored_names

Array = NDArray[np.float64]

USELESS = 1e100  # in any unit; beyond its square statistics would overflow, and none of it is motion of a spacecraft
#: What grows in an unstable loop, as far as it is stored.  Rotations are last: large ones grow with the square.
WATCHED = (
    *(f"{one}_{leg}" for one in ("plant.fine_displacement", "isolator.fine_force") for leg in (1, 2, 3)),
    *(f"plant.payload_rotation.{axis}" for axis in "xyz"),
)
ISOLATED, POINTED = "isolator.enabled", "pointing.enabled"


class Divergence(CosimError):
    """A motion that has grown without limit, as in an unstable loop."""


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
    growth, loop = _find_growth(_read_watched(system, options, case)), describe_loop(system, options, values)
    if growth is None and not loop:
        return None
    causes = [
        "the motion grows without limit" if growth is None else f"the motion grows without limit: {growth}",
        loop or "no loop of the linear model is unstable, so look for a limit, a fault or too long a step",
    ]
    return Divergence(f"{case}: {'. '.join(cause[:1].upper() + cause[1:] for cause in causes)}.\nIt ended by: {error}")


def describe_loop(system: RunSystem, options: RunOptions, values: Mapping[str, Value]) -> str:
    """The unstable poles of the linear model, and what to turn; empty if it is stable, or there is none."""
    on = {name: bool(values.get(name, _get_start(system, name))) for name in (ISOLATED, POINTED)}
    if not on[ISOLATED]:  # then nothing is closed, or a line-of-sight loop alone, of which there is no closed form
        return ""
    try:
        model = read_model(system.structure.with_parameters(values), options.step_s)
        if not on[POINTED]:
            model = model.without_pointing()
        circuit = Circuit(model, active=True)
        if not len(circuit.unstable):
            return ""
        return f"the closed loop is unstable: {describe_unstable(circuit.unstable)}. {circuit.advise()}"
    except (LinearModelError, ParameterError, UsageError, KeyError, np.linalg.LinAlgError):
        return ""


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
