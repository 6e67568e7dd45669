"""Normal numbers that belong to whole numbers: Philox and Box-Muller, compiled.

Box-Muller, since the streams of numpy's own normal numbers may change between its versions.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from . import library

Array = NDArray[np.float64]
Words = ctypes.Array[ctypes.c_uint32]


class Stream(IntEnum):
    """All streams of random numbers of the components: equal seeds must not give two of them the same numbers."""

    GAUSSIAN = 1
    MULTISINE = 2
    WHEEL = 3
    SENSOR_WHITE = 4
    SENSOR_DRIFT = 5
    SENSOR_SPREAD = 6
    TRACKER = 7
    DRIVER = 8


def make_key(stream: Stream, *numbers: int) -> tuple[int, ...]:
    """The words of numbers of a stream, 0 or greater; the first word is of the stream and of how many follow.

    ``numpy.random.SeedSequence`` pads with zeros: without the count (1, 1) would be (1, 1, 0).
    """
    words = make_words(numbers)
    return (stream << 8 | len(words), *words)


def make_words(numbers: Sequence[int]) -> Words:
    """The 32-bit words of whole numbers, 0 or greater, as ``numpy.random.SeedSequence`` takes them."""
    words = []
    for number in numbers:
        words.append(number & 0xFFFFFFFF)
        while number := number >> 32:
            words.append(number & 0xFFFFFFFF)
    return (ctypes.c_uint32 * len(words))(*words)


def draw_keyed(words: Words, rows: int, half: int) -> Array:
    """Rows of normal numbers, (rows, 2 half), that belong to words.

    Of a row, the first half are ``radius cos(angle)``, the others ``radius sin(angle)``, by Box-Muller; the uniform
    numbers, (rows, 2, half), are those of numpy's ``Philox(SeedSequence(words))``.
    """
    normal = np.empty((rows, 2 * half))
    library.find_arithmetic().draw_keyed(words, len(words), rows, half, library.find_address(normal))
    return normal
