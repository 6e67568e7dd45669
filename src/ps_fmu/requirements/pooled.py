"""The distributions of many runs as one: for a requirement that holds at a random time of a random run (mixed).

ECSS-E-ST-60-10C, 4.1.4.2 and A.1.2.  A run hands over its histogram as a text of some kilobytes, and the runs are
summed in groups as they come, so that memory does not grow with their number.
"""

from __future__ import annotations

import base64
import binascii
import struct
import zlib
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ..pointing.confidence import Statement
from .decision import state_of_counts
from .distribution import BINS, Distribution, list_edges

Counts = NDArray[np.int64]

MOST_GROUPS = 400
"""Groups that are resampled; more runs share one.  A group of independent runs is as good a unit as a run, and the
bootstrap of 400 takes 1 s and 80 MB however many runs there are."""
_HEADER = struct.Struct("<dI")  # largest value over the limit; number of bins that are filled


def pack_distribution(found: Distribution) -> str:
    """The largest value over the limit, and the filled bins of a histogram, as a text; :class:`Pool` reads it."""
    bins = np.flatnonzero(found.counts)
    steps = np.diff(bins, prepend=0).astype("<u2")  # between filled bins: most are 1
    counts = found.counts[bins].astype("<u8")
    content = _HEADER.pack(found.peak / found.limit, len(bins)) + steps.tobytes() + counts.tobytes()
    return base64.b64encode(zlib.compress(content)).decode("ascii")


class Pool:
    """Histograms of independent runs of one target of a requirement.

    Parameters
    ----------
    limit: of the target: the histograms are relative to it, and its unit is that of the result.
    runs: how many there will be.
    """

    def __init__(self, limit: float, runs: int) -> None:
        self.limit = limit
        self.runs = 0
        self._peak = 0.0
        self._groups: Counts = np.zeros((min(max(runs, 1), MOST_GROUPS), BINS), dtype=np.int64)

    def add(self, text: str) -> None:
        """Add the histogram of a run.  Raises ``ValueError`` for a text that is none."""
        peak, bins, counts = _unpack(text)
        # In turn: neighbours in a sequence of Sobol' complement each other, and groups of them would differ too little.
        self._groups[self.runs % len(self._groups), bins] += counts
        self._peak = max(self._peak, peak)
        self.runs += 1

    def state(self, probability: float, confidence: float) -> Statement:
        """The quantile of all values with its bound, in the unit of the limit.  Bootstrap over runs."""
        groups = self._groups[: max(1, min(self.runs, len(self._groups)))]
        stated = state_of_counts(groups, list_edges(self.limit, self._peak * self.limit), probability, confidence)
        return replace(stated, independent=float(self.runs))


def pool(texts: Sequence[str], limit: float) -> Pool:
    """A pool of the histograms of runs.  Raises ``ValueError`` for a text that is none."""
    found = Pool(limit, len(texts))
    for text in texts:
        found.add(text)
    return found


def _unpack(text: str) -> tuple[float, NDArray[np.int64], Counts]:
    """Largest value over the limit, filled bins and their counts."""
    try:
        reader = zlib.decompressobj()
        content = reader.decompress(base64.b64decode(text, validate=True), _HEADER.size + 10 * BINS)
        peak, filled = _HEADER.unpack_from(content)
        if not reader.eof or len(content) != _HEADER.size + 10 * filled:
            raise ValueError("it is cut off")
        bins = np.cumsum(np.frombuffer(content, "<u2", filled, _HEADER.size).astype(np.int64))
        counts = np.frombuffer(content, "<u8", filled, _HEADER.size + 2 * filled).astype(np.int64)
    except (binascii.Error, zlib.error, struct.error, ValueError) as error:
        raise ValueError(f"a histogram of a run is damaged: {error}") from error
    if len(bins) and (bins[-1] >= BINS or (np.diff(bins) <= 0).any()):
        raise ValueError("a histogram of a run is damaged: its bins do not ascend")
    return peak, bins, counts
