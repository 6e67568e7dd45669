"""Frequency responses measured on the running FMUs: model, FMUs and master are checked together.

The disturbance FMU shakes the bus with its multisine, along one axis at a time: a mode of the bus that still rings down
is then in the records of the axes that excite it, and in no others.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from itertools import combinations_with_replacement
from typing import TYPE_CHECKING

import numpy as np

from ..disturbance.spectrum import layers
from ..mechanism.parameters import Array
from ..pointing.response import Response, periodic_response
from ..results.observers.sampler import SampleObserver
from ..runs.runner import compute

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
    """Records for each axis, with different phases; a coherence needs two at least."""
    band: tuple[float, float] = (0.15, 110.0)
    """Hz."""
    density: float = 1.0
    """Power spectral density, N2/Hz or N2.m2/Hz."""
    step: float = 1e-4
    """s, of communication."""
    stride: int = 10
    """One row in so many is kept; the band ends far below half that rate, so that nothing is aliased."""

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
        """Start values of the disturbance FMU that shakes along one axis."""
        pairs = combinations_with_replacement(AXES, 2)
        density = {f"{a}_{b}": self.density * (a == b == axis) for a, b in pairs}
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
    threads: int | None = None,
) -> Response:
    """Measure the response from base motion (m, rad; B) to payload rotation (rad; P).

    Parameters
    ----------
    values: start values other than those of the system.
    seed: of the first record of an axis; the others count up from it.
    progress: called after each run.
    threads: runs at a time, by default one for each processor.

    Raises
    ------
    CosimError: a run fails.
    """
    shaken = [
        system.with_parameters({**shaking.values(axis, seed + k), **values})
        for axis in AXES
        for k in range(shaking.seeds)
    ]
    return measure_response(shaken, shaking, BASE_MOTION, PAYLOAD_ROTATION, progress, threads)


def measure_response(
    shaken: Sequence[System],
    shaking: Shaking,
    inputs: Sequence[str],
    outputs: Sequence[str],
    progress: Callable[[], object] | None = None,
    threads: int | None = None,
) -> Response:
    """Run systems that are set up to be shaken, and estimate the response from ``inputs`` to ``outputs``.

    There are ``threads`` runs at a time, by default one for each processor: steps are made without Python's lock, so
    that two processors are 1.7 to 2 times as fast.  ``progress`` is called after each run.  Raises
    :class:`ps_fmu.cosim.CosimError`.
    """
    records = []
    with ThreadPoolExecutor(threads or os.cpu_count()) as pool:
        for record in pool.map(lambda system: _record(system, shaking, (*inputs, *outputs)), shaken):
            records.append(record)
            if progress:
                progress()
    before, after = np.split(np.stack(records), [len(inputs)], axis=2)
    return periodic_response(before, after, shaking.step * shaking.stride, shaking.lines)


def _record(system: System, shaking: Shaking, names: Sequence[str]) -> Array:
    """One run: the kept rows of a period, and two more, (n + 2, names)."""
    end = shaking.settling + shaking.period
    kept = round(shaking.period / (shaking.step * shaking.stride)) + 2
    rows = round(end / shaking.step) - shaking.stride * np.arange(kept)[::-1]
    samples = compute(
        system, shaking.step, end, lambda columns: SampleObserver(columns, names, rows.tolist()), only=names
    )
    return samples.values(*names)
