"""Standard normal numbers that belong to whole numbers, drawn in parts that take little time each."""

from __future__ import annotations

from collections.abc import Generator, Sequence
from typing import Any, TypeVar

import numpy as np

from ..mechanism.quantities import Array
from ..numerics import library
from ..numerics.normal import transform

Parts = Generator[None, None, Array]
"""Work that yields between its parts, and returns what it has made."""
T = TypeVar("T")

_NUMBERS = 9216  # drawn at once by compiled functions: 40 us
_PLAIN_NUMBERS = 2560  # without them: 35 us


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


def count_parts(rows: int, columns: int, *, often: bool = False) -> int:
    """How many parts :func:`draw_in_parts` has."""
    return (0 if often else 2) + -(-rows // _rows_at_once(columns))


def draw_normal(key: Sequence[int], rows: int, columns: int) -> Array:
    """Standard normal numbers (rows, columns) that belong to whole numbers; a row does not depend on how many follow.

    Box-Muller, since the streams of numpy's own normal numbers may change between its versions.
    """
    return finish(draw_in_parts(key, rows, columns))


def seed_in_parts(key: Sequence[int]) -> Generator[None, None, np.random.Generator]:
    """A generator of random numbers that belong to whole numbers, in parts.

    To make one takes 10 us, but 150 us where none was made for a while and none of the code is in a cache.
    """
    sequence = np.random.SeedSequence([value % 2**32 for value in key])
    yield
    philox = np.random.Philox(sequence)
    yield
    return np.random.Generator(philox)


def draw_in_parts(key: Sequence[int], rows: int, columns: int, *, often: bool = False) -> Parts:
    """As :func:`draw_normal`, some rows at a time.  ``often``: so often that its code stays in the caches."""
    random = finish(seed_in_parts(key)) if often else (yield from seed_in_parts(key))
    half = (columns + 1) // 2
    normal = np.empty((rows, 2 * half))
    at_once = _rows_at_once(columns)
    for first in range(0, rows, at_once):
        if first:
            yield
        part = normal[first : first + at_once]
        transform(random.random((len(part), 2, half)), part)
    return normal[:, :columns]


def _rows_at_once(columns: int) -> int:
    numbers = _PLAIN_NUMBERS if library.find_arithmetic() is None else _NUMBERS
    return max(1, numbers // (columns + columns % 2))
