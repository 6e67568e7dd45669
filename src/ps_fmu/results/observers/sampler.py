"""Values of a run at given times."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .observer import NamedColumn, find_columns

Array = NDArray[np.float64]


class SampleObserver:
    """Keeps the rows with the given indices, row 0 being the state after initialisation.

    Parameters
    ----------
    columns: all columns of the run, in the order of the blocks
    names: the columns to keep
    rows: indices of the rows, in any order
    """

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str], rows: Sequence[int]) -> None:
        self.names = tuple(names)
        self._columns = np.array(find_columns(columns, names))
        self._rows = np.asarray(rows, dtype=np.int64)
        self._values = np.full((len(self._rows), len(self.names)), np.nan)

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns) at ``time`` (rows,) [s]."""
        places = self._rows - first_index
        within = np.flatnonzero((places >= 0) & (places < len(time)))
        self._values[within] = values[np.ix_(places[within], self._columns)]

    def values(self, *names: str) -> Array:
        """Values of some columns at the rows, (rows, names); NaN where the run did not get there."""
        return self._values[:, [self.names.index(name) for name in names]]
