"""White noise as a function of sample number and seed alone."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.normal import draw_compiled, make_words, seed, transform

_BLOCK = 512  # samples that one key makes: larger ones would stall a step, smaller ones take longer for each sample
_AT_ONCE = 4  # blocks, compiled: 40 us


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

    def in_parts(self, first: int, n: int) -> Generator[int, None, Array]:
        """As :meth:`__call__`, some blocks at a time: yields how many parts are to come, and returns the samples."""
        at_once = 1 if library.find_arithmetic() is None else _AT_ONCE
        numbers = range(first // _BLOCK, (first + n - 1) // _BLOCK + 1)
        blocks = []
        for number in numbers:
            known, block = self._last
            if known != number:
                block = self._draw(number)
                self._last = number, block
            blocks.append(block)
            if len(blocks) % at_once == 0:
                yield (numbers.stop - 1 - number) // at_once
        begin = first - numbers.start * _BLOCK
        return np.concatenate(blocks)[begin : begin + n]

    def _draw(self, number: int) -> Array:
        """The samples of a block, (_BLOCK, channels)."""
        words, half = make_words((self._seed, number % 2**32)), _BLOCK // 2 * self._channels
        normal = draw_compiled(words, 1, half)
        if normal is None:
            normal = np.empty((1, 2 * half))
            transform(np.random.Generator(np.random.Philox(seed(words))).random((1, 2, half)), normal)
        return normal.reshape(_BLOCK, self._channels)


def sample_deviation(density: float, h: float) -> float:
    """Standard deviation of white noise with a one-sided density (unit/sqrt(Hz)), one sample a step of ``h`` (s).

    The band ends at ``1 / (2 h)``.
    """
    return float(density / np.sqrt(2.0 * h))
