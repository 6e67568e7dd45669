"""Rows of a netCDF variable that has one dimension.

``variable[first:last]`` asks for the length of the time dimension, which netCDF finds by looking at every variable of
the group: with 95 of them that takes 45 us of 60 us.  The methods that netCDF4 itself calls next do without.  It does
not document them; where there are none, the documented way serves.

Whoever opens, reads, writes or closes a dataset holds :data:`...reduction.columns.NETCDF_LOCK`.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

BLOCK_ROWS = 10_000
"""About so many rows are read at once; each time costs some 40 us for each column."""
MOST_BLOCK_ROWS = 1_000_000
"""However long the chunks of a file are, which another program may have written."""


def read_chunk_rows(variable: Any) -> int:
    """Rows of a chunk of a variable in its file; 1 if it is stored in one piece."""
    chunks = variable.chunking()
    return int(chunks[0]) if isinstance(chunks, list) else 1


def iterate_blocks(rows: int, chunk: int, about: int = BLOCK_ROWS) -> Iterator[tuple[int, int]]:
    """First row of each block of so many rows, and the one behind its last.

    A block has whole chunks of the file, so that none is read twice: as many as ``about`` rows hold, at least one.
    """
    size = min(chunk * max(1, about // chunk), MOST_BLOCK_ROWS)
    for first in range(0, rows, size):
        yield first, min(first + size, rows)


def write_rows(variable: Any, first: int, values: NDArray[Any]) -> None:
    """Write ``values`` (n,) from row ``first`` on; they become of the variable's type."""
    values = np.ascontiguousarray(values, dtype=variable.dtype)
    put = getattr(variable, "_put", None)
    if put is None:
        variable[first : first + len(values)] = values
    elif len(values):
        put(values, [first], [len(values)], [1])


def read_rows(variable: Any, first: int, last: int) -> NDArray[Any]:
    """Rows from ``first`` up to ``last``, which is left out; there are so many."""
    get = getattr(variable, "_get", None)
    if get is None or first >= last:
        return np.asarray(variable[first:last])
    return np.asarray(get([first], [last - first], [1]))
