"""Transmissibility measured on the running FMUs: model, FMUs and master are checked as one.

The disturbance FMU shakes the bus with its multisine, along one axis at a time; base motion and payload rotation are
recorded.  One axis at a time, because a mode of the bus that rings down is then in the records of the axes that
excite it alone.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from ..disturbance.spectrum import layers
from ..mechanism.parameters import Array
from ..pointing.response import Response, periodic_response
from ..results.observers.observer import ColumnObserver, NamedColumn

if TYPE_CHECKING:
    from ..cosim import System, Value

AXES = ("fx", "fy", "fz", "tx", "ty", "tz")  # of the shaking: forces and torques in B, at the bus's centre of mass
BASE_MOTION = tuple(f"plant.base_{kind}.{axis}" for kind in ("position", "rotation") for axis in "xyz")
PAYLOAD_ROTATION = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")


@dataclass(frozen=True)
class Shaking:
    """How the system is shaken and recorded."""

    half_period: float = 20.0
    """s; below 20 Hz lines are at odd multiples of 1/40 Hz, none of which meets a mode of the bus; above, at odd
    multiples of 0.1 Hz.  A multiple of 5 s."""
    settling: float = 6.0
    """s, before the record: the multisine rises for 2 s, the suspension has a time constant of 1.3 s."""
    seeds: int = 2
    """Records for each axis, with different phases; two at least for a coherence that says something."""
    band: tuple[float, float] = (0.15, 110.0)
    """Hz."""
    step: float = 1e-4
    """s, of communication."""
    stride: int = 10
    """Every so many rows are kept; the band ends far below half that rate, so that nothing folds."""

    @property
    def period(self) -> float:
        """Length of a record, s."""
        return 2.0 * self.half_period

    @property
    def records(self) -> int:
        """Number of runs."""
        return len(AXES) * self.seeds

    @property
    def lines(self) -> Array:
        """Frequencies of the excitation, (n,), Hz."""
        found = layers(np.array(self.band), self.half_period, half=True, overlap=False)
        return np.concatenate([layer.frequencies for layer in found])

    def values(self, axis: str, seed: int) -> dict[str, Value]:
        """Start values of the disturbance FMU that shakes along one axis, by 1 N2/Hz or 1 N2.m2/Hz."""
        density = {f"{a}_{b}": float(a == b == axis) for a, b in combinations_with_replacement(AXES, 2)}
        return {
            "disturbance.seed": seed,
            "disturbance.noise.enabled": True,
            "disturbance.noise.multisine": True,
            "disturbance.noise.period": self.half_period,
            "disturbance.noise.band.min": self.band[0],
            "disturbance.noise.band.max": self.band[1],
            **{f"disturbance.noise.wrench_psd.{name}": value for name, value in density.items()},
        }


def measure(
    system: System,
    shaking: Shaking,
    values: Mapping[str, Value],
    seed: int = 1,
    progress: Callable[[], object] | None = None,
) -> Response:
    """Response from base motion (m, rad; B) to payload rotation (rad; P) of the system with further start ``values``.

    One run for each processor at a time, on two 1.7 to 2 times as fast: steps are made without Python's lock.
    ``progress`` is called after each run.  Raises :class:`ps_fmu.cosim.CosimError`.
    """
    runs = [{**shaking.values(axis, seed + k), **values} for axis in AXES for k in range(shaking.seeds)]
    records = []
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        for record in pool.map(partial(_record, system, shaking), runs):
            records.append(record)
            if progress:
                progress()
    signals = np.stack(records)
    inputs, outputs = np.split(signals, [len(BASE_MOTION)], axis=2)
    return periodic_response(inputs, outputs, shaking.step * shaking.stride, shaking.lines)


def _record(system: System, shaking: Shaking, values: Mapping[str, Value]) -> Array:
    """One run: the rows of a period, and two more, (n + 2, 9)."""
    from ..cosim import Master

    with Master(system.with_parameters(values), shaking.step) as master:
        master.initialise()
        kept = _EveryNthRow(master.columns, shaking.stride)
        master.run(shaking.settling + shaking.period, [kept])
    return kept.rows()[-round(shaking.period / (shaking.step * shaking.stride)) - 2 :]


class _EveryNthRow(ColumnObserver):
    """Keeps every ``stride``-th row of base motion and payload rotation."""

    def __init__(self, columns: Sequence[NamedColumn], stride: int) -> None:
        super().__init__(columns, (*BASE_MOTION, *PAYLOAD_ROTATION))
        self._stride = stride
        self._skip = 0  # rows of the next block before the first one to keep
        self._kept: list[Array] = []

    def take(self, time: Array, samples: Array) -> None:
        kept = samples[:, self._skip :: self._stride]
        self._skip += self._stride * kept.shape[1] - samples.shape[1]
        self._kept.append(kept.copy())

    def rows(self) -> Array:
        """(rows, 9)."""
        return np.concatenate(self._kept, axis=1).T
