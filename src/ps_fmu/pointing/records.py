"""Statistics of an index over the windows of a record: bias apart from covariance, and the peak."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_BLOCK = 1 << 21  # numbers in a block of windows: 16 MB


@dataclass(frozen=True, eq=False)
class Estimate:
    """An index over the windows of a record."""

    bias: Array  # (signals,), mean over the windows, in the unit of the signals
    covariance: Array  # (signals, signals), unit^2, about the bias; divided by the number of values
    peak: Array  # (signals,), largest magnitude
    windows: int
    """Number of windows; they are not independent samples, see :func:`.confidence.effective_samples`."""

    @property
    def variance(self) -> Array:
        """(signals,), unit^2, about the bias."""
        return np.asarray(np.diag(self.covariance).copy())

    @property
    def std(self) -> Array:
        """(signals,), unit, about the bias."""
        return np.sqrt(self.variance)

    @property
    def rms(self) -> Array:
        """(signals,), unit, with the bias: sqrt(bias^2 + variance)."""
        return np.sqrt(self.bias**2 + self.variance)


def split(record: ArrayLike, count: int, stride: int) -> Iterator[Array]:
    """Windows (windows, count, signals) of a record (n,) or (n, signals), in blocks.

    They start ``stride`` samples apart.  A window that the record does not fill is left out.  Raises ``ValueError`` for
    a record with less than one window, a stride below 1, and values that are not finite.
    """
    record = np.asarray(record, dtype=float)
    record = record[:, None] if record.ndim == 1 else record
    if record.ndim != 2:
        raise ValueError(f"record: expected the shape (n,) or (n, signals), got {record.shape}")
    if stride < 1:
        raise ValueError(f"stride: expected 1 sample or more, got {stride}")
    if len(record) < count:
        raise ValueError(f"record: {len(record)} samples, and a window needs {count}")
    if not np.isfinite(record).all():
        raise ValueError("record: it has values that are not finite")
    view = np.lib.stride_tricks.sliding_window_view(record, count, axis=0)[::stride]
    block = max(1, _BLOCK // (count * record.shape[1]))
    for first in range(0, len(view), block):
        yield np.moveaxis(view[first : first + block], 2, 1)


def estimate(parts: Iterable[Array]) -> Estimate:
    """Bias, covariance and peak of values (windows, r, signals) in blocks."""
    windows, count = 0, 0
    offset = total = squares = peak = np.zeros(0)
    for part in parts:
        values = part.reshape(-1, part.shape[2])
        if not windows:
            # Sums about a value near the mean: those of plain squares would lose a small jitter beside a large bias.
            offset = values.mean(axis=0)
            total, squares, peak = np.zeros(offset.shape), np.zeros((len(offset), len(offset))), np.zeros(offset.shape)
        deviation = values - offset
        windows += len(part)
        count += len(values)
        total = total + deviation.sum(axis=0)
        squares = squares + deviation.T @ deviation
        peak = np.maximum(peak, np.abs(values).max(axis=0))
    mean = total / count
    return Estimate(offset + mean, squares / count - np.outer(mean, mean), peak, windows)
