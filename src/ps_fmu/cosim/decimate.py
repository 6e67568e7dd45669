"""Store every m-th row without folding what lies above the new Nyquist frequency into the result."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .errors import UsageError
from .rows import Array

STOP_BAND_DB = 80.0
"""Attenuation of everything above the new Nyquist frequency."""
PASS_BAND = 0.8
"""The pass band, flat within 1e-4 per stage, ends at this fraction of the new Nyquist frequency."""
CUTOFF = 0.5 * (PASS_BAND + 1.0)
"""Where the gain is one half, the middle of the transition, at this fraction of the new Nyquist frequency."""
HALF_LENGTH = 26
"""Half the length of the filter in output samples: Kaiser's estimate for the two numbers above, rounded up."""
USUAL_STAGE = 100
"""Factor of one stage, where it can be split that far; it holds 5200 rows."""
LARGEST_STAGE = 2000
"""Where it cannot."""


class Decimator:
    """Linear-phase low-pass filters and decimation of columns that arrive block by block.

    Stages one after the other, of at most ``USUAL_STAGE`` each if possible: a filter holds 52 times its factor of rows,
    half a million if each second of a run at 1e-4 s were stored through one.  No delay is left in the result: row k is
    at the time of row k m.  Before the first row and behind the last one the signal is continued
    with that row.  The result does not depend on how the rows are cut into blocks.

    Parameters
    ----------
    factor: m, at least 1; with 1 the rows pass unchanged
    filtered: (columns,) True for those that are filtered; the others (Booleans, Integers, time) are sampled

    Raises :class:`UsageError` for a factor that cannot be split into such stages.
    """

    def __init__(self, factor: int, filtered: NDArray[np.bool_]) -> None:
        self._stages = [_Stage(part, filtered) for part in _split(factor)]
        self._columns = len(filtered)

    @property
    def filters(self) -> list[tuple[int, Array]]:
        """Of each stage the factor m and the taps (2 M + 1,), at the rate of the rows that go into it."""
        return [(stage.factor, stage.taps) for stage in self._stages]

    def push(self, values: Array) -> Array:
        """Take the next rows (rows, columns) and return the rows that are complete now."""
        for stage in self._stages:
            values = stage.push(values)
        return values.copy()

    def finish(self) -> Array:
        """The rows that are left at the end of the run; the last one is repeated behind it."""
        rows = np.zeros((0, self._columns))
        for stage in self._stages:
            rows = np.concatenate([stage.push(rows), stage.finish()])
        return rows


def _split(factor: int) -> list[int]:
    """Factors whose product is ``factor``: of at most ``USUAL_STAGE`` where there are any, the largest first."""
    parts: list[int] = []
    rest = factor
    while rest > 1:
        part = max((n for n in range(2, USUAL_STAGE + 1) if rest % n == 0), default=None)
        part = part or next((n for n in range(USUAL_STAGE, LARGEST_STAGE + 1) if rest % n == 0), None)
        if part is None:
            raise UsageError(
                f"storage_step: {factor} steps cannot be filtered in stages of at most {LARGEST_STAGE}: "
                f"choose a number of steps that {rest} does not divide"
            )
        parts.append(part)
        rest //= part
    return parts


class _Stage:
    """One filter and its decimation: ``y[k] = sum_j h[j] x[k m + j - M]`` with 2 M + 1 symmetric taps."""

    def __init__(self, factor: int, filtered: NDArray[np.bool_]) -> None:
        self.factor = factor
        self._filtered = filtered
        self._half = HALF_LENGTH * factor
        self.taps = _design_filter(factor, self._half)
        self._rows: Array | None = None
        """Rows from k m - M on, where k is the number of the next row to come out."""

    def push(self, values: Array) -> Array:
        if len(values) == 0:
            return values
        if self._rows is None:
            self._rows = np.repeat(values[:1], self._half, axis=0)
        self._rows = np.concatenate([self._rows, values])
        return self._emit(self._rows)

    def finish(self) -> Array:
        if self._rows is None:
            return np.zeros((0, len(self._filtered)))
        return self._emit(np.concatenate([self._rows, np.repeat(self._rows[-1:], self._half, axis=0)]))

    def _emit(self, rows: Array) -> Array:
        count = max(0, (len(rows) - 2 * self._half - 1) // self.factor + 1)
        result = rows[self._half :: self.factor][:count].copy()
        # One product per output row: only what comes out is computed, at the speed of BLAS.
        for number in range(count):
            first = number * self.factor
            row = self.taps @ rows[first : first + len(self.taps)]
            result[number, self._filtered] = row[self._filtered]
        self._rows = rows[count * self.factor :]
        return result


def _design_filter(factor: int, half: int) -> Array:
    from scipy.signal import firwin, kaiser_beta

    taps: Array = firwin(2 * half + 1, CUTOFF / factor, window=("kaiser", kaiser_beta(STOP_BAND_DB)))
    return taps
