"""The next table of a model, made in small parts while the present one is in use: no step then has to wait for it."""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ...numerics.calls import Calls
from .buffer import Array
from .core import Core

RowParts = Generator[int | Calls, None, Array]
"""Rows of a table as a generator: after each part of its work it yields how many are to come, or calls that it wants to
be made before it goes on; it returns the rows.  Memory that calls touch lives as long as they."""

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
    """One table under way.  Its key is all that it depends on: origin (s), first count, step (s), number of rows.

    Calls that wait are in the words of the core: the launcher makes them, too.
    """

    def __init__(self, core: Core) -> None:
        self._core = core
        self.drop()

    def drop(self) -> None:
        """Forget it: what it was made from has changed."""
        self._core.calls = None  # before their memory goes
        self._calls: Calls | None = None
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
        calls = self._calls
        try:
            if calls is None or not calls.left:
                return self._note(next(self._parts))
            calls.make_next()
            return calls.left + calls.later
        except StopIteration as end:
            table = end.value
            self._end()
            self._table = table
        except Exception:
            self.drop()
        except BaseException:  # Ctrl-C: a call may be counted that was not made
            self.drop()
            raise
        return 0

    def take(self, key: _Key) -> Array | None:
        """The table of this key, with all that is left of the work; None if another one was begun, or none."""
        found, parts, table = self._key, self._parts, self._table
        self.drop()
        if key != found:
            return None
        return table if parts is None else finish(parts)

    def _note(self, part: int | Calls) -> int:
        """What the generator has yielded; how many parts are still to come."""
        if isinstance(part, (int, np.integer)):
            self._core.calls, self._calls = None, None
            return max(int(part), 1)
        self._core.calls, self._calls = part.address, part
        return part.left + part.later

    def _end(self) -> None:
        self._core.calls, self._calls, self._parts = None, None, None
