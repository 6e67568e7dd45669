"""Standard normal numbers that belong to whole numbers, and work in parts that take little time each."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any, TypeVar

import numpy as np

from ..mechanism.quantities import Array
from ..numerics.normal import draw_keyed, make_words, seed

Parts = Generator[None, None, Array]
"""Work that yields between its parts, and returns what it has made."""
T = TypeVar("T")


def finish(parts: Generator[Any, None, T]) -> T:
    """What the parts make, all at once."""
    while True:
        try:
            next(parts)
        except StopIteration as end:
            made: T = end.value
            return made


def count(parts: Generator[Any, None, T], left: int) -> Generator[int, None, T]:
    """The same parts; the first says that ``left`` are still to come, and each other one less, but at least one."""
    while True:
        try:
            next(parts)
        except StopIteration as end:
            made: T = end.value
            return made
        yield max(left, 1)
        left -= 1


def draw_normal(key: Sequence[int], rows: int, columns: int) -> Array:
    """Standard normal numbers (rows, columns) that belong to whole numbers.

    A row does not depend on how many follow.
    """
    return draw_keyed(make_words(wrap(key)), rows, (columns + 1) // 2)[:, :columns]


def seed_in_parts(key: Sequence[int]) -> Generator[None, None, np.random.Generator]:
    """A generator of random numbers that belong to whole numbers, in parts.

    To make one takes 10 us, but 150 us where none was made for a while and none of the code is in a cache.
    """
    sequence = seed(make_words(wrap(key)))
    yield
    philox = np.random.Philox(sequence)
    yield
    return np.random.Generator(philox)


def wrap(key: Sequence[int]) -> list[int]:
    """Whole numbers as one word each."""
    return [value % 2**32 for value in key]
