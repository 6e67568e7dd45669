"""Pointing performance indices of ECSS-E-ST-60-10C, block by block.

The standard of 15 November 2008, clause 3.2 and annex A.1.  With the performance error e(t) and windows
of length dt that follow one another without a gap::

    APE(t)     = e(t)                            absolute performance error
    MPE(k)     = <e> over window k               mean performance error
    RPE(t, dt) = e(t) - <e> over the window      relative performance error; t lies in the window
    PDE(k)     = MPE(k + d) - MPE(k)             performance drift error, between windows d apart

For an optical link dt is the time over which the receiver averages; for a camera the exposure.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .observer import ColumnObserver, NamedColumn, count_rows
from .statistics import Statistics

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Indices:
    """Peak and RMS of each index over the run: arrays of shape (signals,) in the signal's unit."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    window_s: float
    drift_s: float  # time between the windows that the PDE compares
    windows: int  # whole windows seen
    ape_peak: Array
    ape_rms: Array
    mpe_peak: Array
    mpe_rms: Array
    rpe_peak: Array
    rpe_rms: Array
    pde_peak: Array  # NaN until there are two windows that far apart
    pde_rms: Array


class PerformanceIndices(ColumnObserver):
    """APE, MPE, RPE and PDE of the named columns.

    Parameters
    ----------
    window_s: length of a window [s], a whole number of steps, two at least
    step_s: time between rows [s]
    drift_windows: distance of the two windows that the PDE compares, in windows
    start_s: the first window starts at the first row at or after this time [s]

    A window that the run does not fill is left out of MPE, RPE and PDE; APE covers all rows.
    """

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        names: Sequence[str],
        *,
        window_s: float,
        step_s: float,
        drift_windows: int = 1,
        start_s: float = -math.inf,
    ) -> None:
        super().__init__(columns, names, start_s=start_s)
        self.window_s = window_s
        self._rows = count_rows(window_s, step_s, "window")
        if self._rows < 2:
            raise ValueError(f"window: {window_s!r} s is one step; a mean needs two at least")
        if drift_windows < 1:
            raise ValueError(f"drift_windows: expected 1 or more, got {drift_windows}")
        self._lag = drift_windows
        signals = len(self.names)
        self._ape = Statistics(columns, names)
        self._windows = 0
        self._drifts = 0
        self._rest = np.empty((signals, 0))  # rows of the window that is not full yet
        self._means = np.empty((signals, 0))  # means of the last windows, for the PDE
        self._squares = {index: np.zeros(signals) for index in ("mpe", "rpe", "pde")}
        self._peaks = {index: np.zeros(signals) for index in ("mpe", "rpe", "pde")}

    def take(self, time: Array, samples: Array) -> None:
        """Cut the rows into windows and add up the whole ones."""
        self._ape.take(time, samples)
        joined = np.concatenate((self._rest, samples), axis=1)
        whole = joined.shape[1] // self._rows
        self._rest = joined[:, whole * self._rows :].copy()
        if not whole:
            return
        windows = joined[:, : whole * self._rows].reshape(len(self.names), whole, self._rows)
        means = windows.mean(axis=2)
        deviation = windows - means[:, :, None]
        self._add("mpe", np.square(means).sum(axis=1), np.abs(means).max(axis=1))
        self._add("rpe", np.square(deviation).mean(axis=2).sum(axis=1), np.abs(deviation).max(axis=(1, 2)))
        self._windows += whole
        means = np.concatenate((self._means, means), axis=1)
        drift = means[:, self._lag :] - means[:, : -self._lag]
        if drift.shape[1]:
            self._add("pde", np.square(drift).sum(axis=1), np.abs(drift).max(axis=1))
            self._drifts += drift.shape[1]
        self._means = means[:, -self._lag :].copy()

    def _add(self, index: str, squares: Array, peak: Array) -> None:
        self._squares[index] += squares
        np.maximum(self._peaks[index], peak, out=self._peaks[index])

    def result(self) -> Indices:
        """The indices so far; raises ``ValueError`` if no window was filled."""
        if not self._windows:
            raise ValueError(f"the run is shorter than one window of {self.window_s} s")
        ape = self._ape.result()
        none = np.full(len(self.names), np.nan)
        return Indices(
            names=self.names,
            units=self.units,
            window_s=self.window_s,
            drift_s=self._lag * self.window_s,
            windows=self._windows,
            ape_peak=ape.peak,
            ape_rms=ape.rms,
            mpe_peak=self._peaks["mpe"].copy(),
            mpe_rms=np.sqrt(self._squares["mpe"] / self._windows),
            rpe_peak=self._peaks["rpe"].copy(),
            rpe_rms=np.sqrt(self._squares["rpe"] / self._windows),
            pde_peak=self._peaks["pde"].copy() if self._drifts else none,
            pde_rms=np.sqrt(self._squares["pde"] / self._drifts) if self._drifts else none.copy(),
        )
