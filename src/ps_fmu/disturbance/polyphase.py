"""Spectral lines to samples in small parts: every P-th sample by a transform of its own.

With N = P n, sample number P m + j of ``Re sum_k c_k exp(2 pi i k (P m + j) / N)`` is sample number m of
``Re sum_k (c_k exp(2 pi i k j / N)) exp(2 pi i k m / n)``: a transform of n points, in which lines above n/2 appear as
their aliases.  One of 2500 points takes 15 us, one of 50 000 takes 400 us.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from ..mechanism.quantities import Array, Complex
from .spectrum import Layer

_MOST_POINTS = 2500  # of a transform
_FEWEST_POINTS = 500  # with fewer, parts cost more than they compute: one transform for all samples instead


class Polyphase:
    """Samples of the lines of a layer, phase by phase.

    Attributes
    ----------
    phases: P.  Phase j has the samples j, j + P, ...
    points: n, samples of a phase.
    turns: exp(2 pi i k j / N) of line k and phase j, (phases, lines).
    roots: exp(2 pi i m / n), (points,).
    runs: lines that go to bins side by side, their bins, and whether their conjugates go there.
    gain: what the lines have to be multiplied by, (lines,).
    """

    def __init__(self, layer: Layer) -> None:
        total, numbers = layer.points, layer.numbers
        self.points = _choose_points(total)
        self.phases = total // self.points
        roots = np.exp(2j * np.pi / total * np.arange(total))
        self.turns = roots[np.outer(np.arange(self.phases), numbers) % total]
        self.roots = np.ascontiguousarray(roots[:: self.phases])
        # Runs of lines that go to bins side by side: up from 0 to n/2, then down again, and so on.
        runs = 2 * numbers // self.points
        edges = [0, *(np.flatnonzero(np.diff(runs)) + 1).tolist(), numbers.size]
        self.runs = [
            (slice(first, end), self._find_bins(int(numbers[first]), int(numbers[end - 1]), int(runs[first])))
            for first, end in pairwise(edges)
        ]
        # A transform counts a line at 0 or n/2 once, all others twice.
        once = (2 * numbers) % self.points == 0
        self.gain = np.where(once, 1.0, 0.5) * self.points

    def _find_bins(self, first: int, last: int, run: int) -> tuple[slice, bool]:
        """The bins of the lines from ``first`` to ``last``, and whether their conjugates go there."""
        n = self.points
        if run % 2 == 0:
            shift = run // 2 * n
            return slice(first - shift, last - shift + 1), False
        shift = (run + 1) // 2 * n
        end = shift - last - 1
        return slice(shift - first, end if end >= 0 else None, -1), True

    @property
    def bins(self) -> int:
        """Of the spectrum of a phase."""
        return self.points // 2 + 1

    def fold(self, lines: Complex, phase: int) -> Complex:
        """The spectra of a phase (..., bins), for amplitudes (..., lines) that are multiplied by ``gain``."""
        turned = lines * self.turns[phase]
        spectra = np.zeros((*lines.shape[:-1], self.bins), dtype=np.complex128)
        for part, (bins, is_mirrored) in self.runs:
            spectra[..., bins] += turned[..., part].conj() if is_mirrored else turned[..., part]
        return spectra

    def transform(self, spectra: Complex) -> Array:
        """Samples (..., n) of a phase from its spectra (..., bins)."""
        return np.asarray(np.fft.irfft(spectra, self.points, axis=-1))


def _choose_points(total: int) -> int:
    """The largest divisor that makes small transforms."""
    found = [n for n in range(_FEWEST_POINTS, _MOST_POINTS + 1) if total % n == 0]
    return max(found, default=total)
