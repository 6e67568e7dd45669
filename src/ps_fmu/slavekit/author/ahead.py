"""The next table of a model, made in small parts while the present one is in use: no step then has to wait for it."""

from __future__ import annotations

from collections.abc import Generator

from .buffer import Array

RowParts = Generator[int, None, Array]
"""Rows of a table as a generator: after each part of its work it yields how many are to come; it returns the rows."""

_Key = tuple[float, int, float, int]


def finish(rows: Array | RowParts) -> Array:
    """The rows, whatever is still to be done for them."""
    if not isinstance(rows, Generator):
        return rows
    while True:
        try:
            next(rows)
        except StopIteration as end:
            made: Array = end.value
            return made


class TableAhead:
    """One table under way.  Its key is all that it depends on: origin (s), first count, step (s), number of rows."""

    def __init__(self) -> None:
        self.drop()

    def drop(self) -> None:
        """Forget it: what it was made from has changed."""
        self._key: _Key | None = None
        self._parts: RowParts | None = None
        self._table: Array | None = None

    def begin(self, key: _Key, parts: RowParts) -> None:
        """Begin with another table."""
        self.drop()
        self._key, self._parts = key, parts

    def advance(self) -> int:
        """Do the next part; how many are still to come.

        A table that fails is forgotten: it fails again when it is needed, and is told then.
        """
        if self._parts is None:
            return 0
        try:
            return max(int(next(self._parts)), 1)
        except StopIteration as end:
            self._table, self._parts = end.value, None
        except Exception:
            self.drop()
        return 0

    def take(self, key: _Key) -> Array | None:
        """The table of this key, with all that is left of the work; None if another one was begun, or none."""
        found, parts, table = self._key, self._parts, self._table
        self.drop()
        if key != found:
            return None
        return table if parts is None else finish(parts)
