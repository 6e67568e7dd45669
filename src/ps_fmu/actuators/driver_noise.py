"""White noise as a function of sample number and seed alone."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..mechanism.quantities import Array
from ..numerics.calls import Calls
from ..numerics.normal import Stream, Words, make_calls, make_key, make_words

_BLOCK = 512  # samples that one key makes: larger ones would stall a step, smaller ones take longer for each sample
_AT_ONCE = 2  # blocks: 20 us


class WhiteNoise:
    """Independent Gaussian numbers of unit variance, any sample on its own.

    Parameters
    ----------
    seed: 0 or greater.
    channels: numbers in a sample.
    """

    def __init__(self, seed: int, channels: int) -> None:
        self._seed, self._channels = seed, channels
        self._last = (-1, np.empty((0, channels)))  # number and samples of a block: the next call often needs it

    def __call__(self, first: int, n: int) -> Array:
        """The samples ``first`` to ``first + n - 1``, shape (n, channels)."""
        parts = self.in_parts(first, n)
        while True:
            try:
                next(parts)
            except StopIteration as end:
                return np.asarray(end.value)

    def in_parts(self, first: int, n: int) -> Generator[Calls, None, Array]:
        """As :meth:`__call__`, a block at a time: yields calls, and returns the samples."""
        numbers = range(first // _BLOCK, (first + n - 1) // _BLOCK + 1)
        blocks = np.empty((len(numbers), _BLOCK, self._channels))
        known, samples = self._last
        skipped = int(known == numbers[0])
        if skipped:
            blocks[0] = samples
        half = _BLOCK // 2 * self._channels
        rest = blocks[skipped:].reshape(-1, 2 * half)
        yield from Calls(make_calls(self._make_words(numbers[0] + skipped), half, rest, _AT_ONCE), blocks)
        self._last = numbers[-1], blocks[-1].copy()  # not all of them for the sake of one
        begin = first - numbers.start * _BLOCK
        return blocks.reshape(-1, self._channels)[begin : begin + n]

    def _make_words(self, number: int) -> Words:
        return make_words(make_key(Stream.DRIVER, self._seed, number % 2**32))


def sample_deviation(density: float, h: float) -> float:
    """Standard deviation of white noise with a one-sided density (unit/sqrt(Hz)), one sample a step of ``h`` (s).

    The band ends at ``1 / (2 h)``.
    """
    return float(density / np.sqrt(2.0 * h))
