"""Standard normal numbers that belong to whole numbers, drawn in parts that take little time each."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any, TypeVar

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.normal import draw_compiled, make_words, seed, transform

Parts = Generator[None, None, Array]
"""Work that yields between its parts, and returns what it has made."""
T = TypeVar("T")

_NUMBERS = 2560  # drawn at once without compiled functions: 35 us


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


def count_parts(rows: int, columns: int) -> int:
    """How many parts :func:`draw_in_parts` has."""
    return 1 if library.find_arithmetic() is not None else 2 + -(-rows // _rows_at_once(columns))


def draw_normal(key: Sequence[int], rows: int, columns: int) -> Array:
    """Standard normal numbers (rows, columns) that belong to whole numbers.

    A row does not depend on how many follow.
    """
    return finish(draw_in_parts(key, rows, columns))


def seed_in_parts(key: Sequence[int]) -> Generator[None, None, np.random.Generator]:
    """A generator of random numbers that belong to whole numbers, in parts.

    To make one takes 10 us, but 150 us where none was made for a while and none of the code is in a cache.
    """
    sequence = seed(make_words(wrap(key)))
    yield
    philox = np.random.Philox(sequence)
    yield
    return np.random.Generator(philox)


def draw_in_parts(key: Sequence[int], rows: int, columns: int) -> Parts:
    """As :func:`draw_normal`; without compiled functions, some rows at a time."""
    half = (columns + 1) // 2
    normal = draw_compiled(make_words(wrap(key)), rows, half)
    if normal is None:
        random = yield from seed_in_parts(key)
        normal = np.empty((rows, 2 * half))
        at_once = _rows_at_once(columns)
        for first in range(0, rows, at_once):
            if first:
                yield
            part = normal[first : first + at_once]
            transform(random.random((len(part), 2, half)), part)
    return normal[:, :columns]


def wrap(key: Sequence[int]) -> list[int]:
    """Whole numbers as one word each."""
    return [value % 2**32 for value in key]


def _rows_at_once(columns: int) -> int:
    return max(1, _NUMBERS // (columns + columns % 2))
