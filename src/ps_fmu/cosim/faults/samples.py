"""Random numbers that belong to the number of a step: a function of seed, signal and step alone.

Each block of steps has a generator of its own: J. Salmon et al., Parallel random numbers: as easy as 1, 2, 3 (2011).
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

import numpy as np

from ..rows import Array

BLOCK = 1024
"""Steps whose numbers are drawn together: 15 us."""


class Samples:
    """Numbers of the steps: standard normal, or uniform in [0, 1).

    Parameters
    ----------
    seed: not negative
    name: of the signal and what the numbers are for: others have other numbers
    normal: which of the two
    """

    def __init__(self, seed: int, name: str, *, normal: bool) -> None:
        digest = hashlib.sha256(f"{seed} {name}".encode()).digest()
        self._key = [int.from_bytes(digest[k : k + 8], "little") for k in (0, 8)]
        self._normal = normal
        self._block, self._numbers = -1, np.empty(0)

    def draw(self, first: int, count: int) -> Array:
        """The numbers of ``count`` steps from ``first`` on, (count,)."""
        parts = []
        while count > 0:
            block, place = divmod(first, BLOCK)
            part = self._draw_block(block)[place : place + count]
            parts.append(part)
            first, count = first + len(part), count - len(part)
        return np.concatenate(parts) if parts else np.empty(0)

    def _draw_block(self, block: int) -> Array:
        if block != self._block:
            generator = np.random.Generator(np.random.Philox(key=self._key, counter=[0, 0, block, 0]))
            draw: Callable[[int], Array] = generator.standard_normal if self._normal else generator.random
            self._block, self._numbers = block, draw(BLOCK)
        return self._numbers
