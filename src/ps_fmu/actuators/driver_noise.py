"""White noise as a function of sample number and seed alone."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..mechanism.quantities import Array
from ..numerics.calls import Calls
from ..numerics.normal import make_call, make_words, seed, transform

_BLOCK = 512  # samples that one key makes: larger ones would stall a step, smaller ones take longer for each sample


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

    def in_parts(self, first: int, n: int) -> Generator[int | Calls, None, Array]:
        """As :meth:`__call__`, a block at a time: yields how many parts are to come, or calls; returns the samples."""
        numbers = range(first // _BLOCK, (first + n - 1) // _BLOCK + 1)
        blocks = np.empty((len(numbers), _BLOCK, self._channels))
        half, work = _BLOCK // 2 * self._channels, []
        for number, block in zip(numbers, blocks, strict=True):
            known, samples = self._last
            words = make_words((self._seed, number % 2**32))
            if known == number:
                block[:] = samples
            elif (call := make_call(words, half, block)) is not None:
                work.append(call)
            else:
                random = np.random.Generator(np.random.Philox(seed(words))).random((1, 2, half))
                transform(random, block.reshape(1, 2 * half))
                yield numbers.stop - 1 - number
        if work:
            yield from Calls(work, blocks)
        self._last = numbers[-1], blocks[-1].copy()  # not all of them for the sake of one
        begin = first - numbers.start * _BLOCK
        return blocks.reshape(-1, self._channels)[begin : begin + n]


def sample_deviation(density: float, h: float) -> float:
    """Standard deviation of white noise with a one-sided density (unit/sqrt(Hz)), one sample a step of ``h`` (s).

    The band ends at ``1 / (2 h)``.
    """
    return float(density / np.sqrt(2.0 * h))
