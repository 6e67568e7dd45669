"""Values of a run at given times."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .kept import RowJournal, State
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
        self._journal: RowJournal | None = None

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take ``values`` (rows, columns) at ``time`` (rows,) [s]."""
        places = self._rows - first_index
        within = np.flatnonzero((places >= 0) & (places < len(time)))
        found = values[np.ix_(places[within], self._columns)]
        self._values[within] = found
        if self._journal is not None:
            self._journal.append(np.column_stack((within, found)))

    @property
    def journal_width(self) -> int:
        """Numbers in a row of the journal: the place of the row, and its values."""
        return 1 + len(self.names)

    def use_journal(self, journal: RowJournal) -> None:
        """Add the rows to a journal, too, which has them for a checkpoint."""
        self._journal = journal

    def save_state(self) -> dict[str, Any]:
        """What a checkpoint keeps besides the journal: nothing."""
        return {}

    def load_state(self, state: State) -> None:
        """Take the rows of the journal.  Raises ValueError for a row that is not wanted."""
        assert self._journal is not None
        for rows in self._journal.read():
            places = rows[:, 0].astype(np.int64)
            if ((places < 0) | (places >= len(self._values)) | (places != rows[:, 0])).any():
                raise ValueError(f"rows of the journal: expected places from 0 to {len(self._values) - 1}")
            self._values[places] = rows[:, 1:]

    def values(self, *names: str) -> Array:
        """Values of some columns at the rows, (rows, names); NaN where the run did not get there."""
        return self._values[:, [self.names.index(name) for name in names]]
