"""Store every m-th row without folding what lies above the new Nyquist frequency into the result."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from math import ceil, inf
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...reduction.lowpass import OUTPUTS, Thinning
from ..errors import UsageError
from ..rows import Array

STOP_BAND_DB = 80.0
"""Attenuation of everything above the new Nyquist frequency."""
PASS_BAND = 0.8
"""The pass band, flat within 2e-4, ends at this fraction of the new Nyquist frequency."""
EARLY_STOP_BAND_DB = 100.0
"""That of all stages but the last one, so that they add little (3e-5 each) to its ripple in the pass band (1e-4)."""
LARGEST_STAGE = 2000
"""Factor of one stage; it holds 52 times as many rows, if it is the last one."""
CALL = 60
"""How many products per column and row take as long as the rest that a row of a stage costs, with some 90 columns."""
HALF_LENGTH = 26
"""Half the length of the filter of the last stage, in rows that come out: Kaiser's estimate, rounded up."""


class Filter(NamedTuple):
    """The low-pass of a stage; frequencies in cycles per row that goes into it."""

    factor: int
    """Of so many rows that are filtered, one comes out."""
    taps: Array
    """(2 M + 1,)"""
    pass_band: float
    """Its end."""
    stop_band: float
    """Its beginning."""
    attenuation_db: float


class Decimator:
    """Linear-phase low-pass filters and decimation of columns that arrive block by block.

    Stages one after the other, as many as there are factors: all but the last one have to hold back only what would be
    folded into the final band, so that their filters are short, and the last one has few rows left to filter.  No delay
    is left in the result: row k is at the time of row k m.  Before the first row and behind the last one the signal is
    continued with that row.  The result does not depend on how the rows are cut into blocks.

    Parameters
    ----------
    factor: m, at least 1; with 1 the rows pass unchanged
    filtered: (columns,) True for those that are filtered; the others (Booleans, Integers, time) are sampled

    Raises :class:`UsageError` for a factor that cannot be split into such stages.
    """

    def __init__(self, factor: int, filtered: NDArray[np.bool_]) -> None:
        self._stages = []
        later = factor
        for part in _split(factor):
            later //= part
            self._stages.append(_Stage(part, later, filtered))
        self._columns = len(filtered)

    @property
    def filters(self) -> list[Filter]:
        """Those that the rows go through, the first one first."""
        return [stage.filter for stage in self._stages]

    def push(self, values: Array) -> Array:
        """Take the next rows (rows, columns) and return those that are complete now; for a factor of 1, ``values``."""
        for stage in self._stages:
            values = stage.push(values)
        return values

    def save_state(self) -> dict[str, Any]:
        """The rows that wait in each stage, for a checkpoint."""
        return {"waiting": [stage.waiting_rows for stage in self._stages]}

    def load_state(self, state: Mapping[str, Any]) -> None:
        """Go on from a state of :meth:`save_state`.  Raises KeyError or ValueError for one that is none."""
        for stage, rows in zip(self._stages, state["waiting"], strict=True):
            stage.load_rows(rows)

    def finish(self) -> Array:
        """The rows that are left at the end of the run; the last one is repeated behind it."""
        rows = np.zeros((0, self._columns))
        for stage in self._stages:
            rows = np.concatenate([stage.push(rows), stage.finish()])
        return rows


def _split(factor: int) -> list[int]:
    """Factors of the stages, the first one first; their product is ``factor``."""
    cost, parts = _find_cheapest(factor)
    if cost == inf:
        rest = factor
        for n in range(2, LARGEST_STAGE + 1):
            while rest % n == 0:
                rest //= n
        raise UsageError(
            f"storage_step: {factor} steps cannot be filtered in stages of at most {LARGEST_STAGE}.\n"
            f"  Choose a number of steps that {rest} does not divide."
        )
    return list(parts)


@cache
def _find_cheapest(factor: int) -> tuple[float, tuple[int, ...]]:
    """Products per column and row that comes in, and the factors of the stages that make the fewest."""
    if factor == 1:
        return 0.0, ()
    found: tuple[float, tuple[int, ...]] = (inf, ())
    for part in range(2, min(factor, LARGEST_STAGE) + 1):
        if factor % part == 0:
            later, parts = _find_cheapest(factor // part)
            length = 2 * _half_length(part, factor // part) + (OUTPUTS - 1) * part + CALL
            found = min(found, ((length + later) / part, (part, *parts)))
    return found


def _half_length(factor: int, later: int) -> int:
    """Half the length of the filter of a stage, in rows that come in; ``later``: factor of all stages behind it."""
    # J. F. Kaiser, Proc. IEEE Int. Symp. Circuits and Systems, 1974: (dB - 7.95) / (14.36 width)
    longer = (EARLY_STOP_BAND_DB - 7.95) / (STOP_BAND_DB - 7.95) if later > 1 else 1.0
    begin, end = _find_edges(factor, later)
    return ceil(HALF_LENGTH * longer * (1.0 - PASS_BAND) / 2.0 / (end - begin) * (1.0 - 1e-12))


def _find_edges(factor: int, later: int) -> tuple[float, float]:
    """End of the pass band and beginning of the stop band of a stage, in cycles per row that comes in.

    The pass band is the final one, and stopped is what would be folded to below the final Nyquist frequency.
    """
    nyquist = 0.5 / (factor * later)
    return PASS_BAND * nyquist, 1.0 / factor - nyquist


class _Stage:
    """One filter and its decimation: ``y[k] = sum_j h[j] x[k m + j - M]`` with 2 M + 1 symmetric taps.

    A row of 94 columns costs 0.06 us with stages of 5 and 2 for a factor of 10.
    """

    def __init__(self, factor: int, later: int, filtered: NDArray[np.bool_]) -> None:
        self._half = _half_length(factor, later)
        self.filter = _design_filter(factor, later)
        self._thinning = Thinning(self.filter.taps, factor, ~filtered)

    @property
    def waiting_rows(self) -> Array:
        return self._thinning.waiting

    def load_rows(self, rows: Array) -> None:
        self._thinning.waiting = rows

    def push(self, values: Array) -> Array:
        if len(values) == 0:
            return values
        if not len(self._thinning.waiting):
            self._thinning.waiting = np.repeat(values[:1], self._half, axis=0)
        return self._thinning.push(np.ascontiguousarray(values))

    def finish(self) -> Array:
        last = self._thinning.waiting[-1:]
        return self.push(np.repeat(last, self._half, axis=0))


def _design_filter(factor: int, later: int) -> Filter:
    """Kaiser's window on the ideal low-pass: taps with a static gain of one (J. F. Kaiser, Proc. ISCAS 1974).

    As ``scipy.signal.firwin``, which takes 1.5 s to import.
    """
    attenuation = EARLY_STOP_BAND_DB if later > 1 else STOP_BAND_DB
    begin, end = _find_edges(factor, later)
    half = _half_length(factor, later)
    beta = 0.1102 * (attenuation - 8.7)  # for a stop band of more than 50 dB
    taps = np.sinc((begin + end) * np.arange(-half, half + 1)) * np.kaiser(2 * half + 1, beta)
    return Filter(factor, np.asarray(taps / taps.sum()), begin, end, attenuation)
