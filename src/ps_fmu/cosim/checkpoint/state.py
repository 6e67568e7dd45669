"""What a checkpoint holds: a tree of numbers, texts, arrays and bytes, and those who have such a state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..errors import CosimError

Array = NDArray[np.float64]
State: TypeAlias = Any
"""None, a Boolean, an int, a float, a text, bytes, an array of numbers, or a list or a dict (of texts) of such."""


class CheckpointError(CosimError, OSError):
    """A checkpoint that cannot be written, read or used: the text says which, and what to do."""


@runtime_checkable
class Stateful(Protocol):
    """An observer whose state can be kept and given back: it goes on as if it had seen all rows itself."""

    def save_state(self) -> Mapping[str, State]:
        """The state now; what is in it is not changed later."""

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over a state of an observer that was made in the same way.  Raises ValueError or KeyError: no such."""


class RowJournal(Protocol):
    """A file to which an observer adds rows, so that its state need not hold them all."""

    def append(self, rows: Array) -> None:
        """Add rows (rows, width)."""

    def read(self) -> Iterator[Array]:
        """All rows so far, some thousand at a time."""


@runtime_checkable
class Journaled(Stateful, Protocol):
    """An observer that keeps each row, or many: they go into a journal, once, and not into each checkpoint."""

    @property
    def journal_width(self) -> int:
        """Numbers in a row of the journal."""

    def use_journal(self, journal: RowJournal) -> None:
        """Add rows to this journal from now on; :meth:`load_state` finds those of before in it."""
