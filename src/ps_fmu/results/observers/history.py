"""All rows of a few signals, for what needs the whole history at once."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .kept import RowJournal, State
from .observer import ColumnObserver, NamedColumn

Array = NDArray[np.float64]


class HistoryObserver(ColumnObserver):
    """Keeps every row of the named columns: 8 bytes for each value, 24 MB for 3 signals over 100 s at 0.1 ms."""

    def __init__(self, columns: Sequence[NamedColumn], names: Sequence[str]) -> None:
        super().__init__(columns, names)
        self._blocks: list[Array] = []
        self._journal: RowJournal | None = None

    def take(self, time: Array, samples: Array) -> None:
        """Keep the rows."""
        self._blocks.append(samples)
        if self._journal is not None:
            self._journal.append(samples.T)

    @property
    def journal_width(self) -> int:
        """Numbers in a row of the journal."""
        return len(self.names)

    def use_journal(self, journal: RowJournal) -> None:
        """Add the rows to a journal, too, which has them for a checkpoint."""
        self._journal = journal

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`: the rows are in the journal."""
        assert self._journal is not None
        self._blocks = [np.ascontiguousarray(rows.T) for rows in self._journal.read()]

    def result(self) -> Array:
        """(signals, rows).  Raises ``ValueError`` if no row has been seen."""
        if not self._blocks:
            raise ValueError("no rows seen")
        self._blocks = [np.concatenate(self._blocks, axis=1)]
        return self._blocks[0]
