"""Helpers of the results tests: columns, and feeding a record to an observer in blocks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pytest


@dataclass(frozen=True)
class Column:
    """The part of a recorded column that observers use."""

    name: str
    unit: str


@pytest.fixture(scope="session")
def columns() -> list[Column]:
    """Four columns, of which the tests observe some."""
    return [Column("a.x", "rad"), Column("a.y", "rad"), Column("b.u", "m"), Column("b.v", "m")]


@pytest.fixture(scope="session")
def feed() -> Callable:
    """``feed(observer, values, step, cuts)`` hands over ``values`` (rows, columns) in blocks.

    The array is reused for each block, as the master does.
    """

    def feed_in_blocks(observer: object, values: np.ndarray, step: float, cuts: Sequence[int] = ()) -> object:
        edges = [0, *sorted({cut for cut in cuts if 0 < cut < len(values)}), len(values)]
        for first, last in pairwise(edges):
            block = values[first:last].copy()
            observer.block(first, np.arange(first, last) * step, block)
            block[:] = np.nan
        return observer

    return feed_in_blocks
