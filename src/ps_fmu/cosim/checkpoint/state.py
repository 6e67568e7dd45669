"""What a checkpoint holds: a tree of numbers, texts, arrays and bytes, and those who have such a state."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from ..errors import CosimError

Array = NDArray[np.float64]
State: TypeAlias = Any
"""None, a Boolean, an int, a float, a text, bytes, an array of numbers, or a list or a dict (of texts) of such."""


class CheckpointError(CosimError, OSError):
    """A checkpoint that cannot be written, read or used: the text says which, and what to do."""


class DamagedCheckpointError(CheckpointError):
    """A file of a checkpoint that is gone, or whose content is not what was written: no run can go on from it.

    ``path``: the file.
    """

    def __init__(self, path: Path, what: str) -> None:
        super().__init__(f"{path}: {what}")
        self.path = path


@runtime_checkable
class Stateful(Protocol):
    """Whose state can be kept and given back: an observer goes on as if it had seen all rows itself, a part of the
    exchange as if it had made all steps."""

    def save_state(self) -> Mapping[str, State]:
        """The state now; what is in it is not changed later."""

    def load_state(self, state: Mapping[str, State]) -> None:
        """Take over a state of one that was made in the same way.  Raises ValueError or KeyError: no such."""


def copy_into(target: Array, kept: State) -> None:
    """Overwrite an array in place.  Raises ValueError unless what was kept is an array of its type and shape."""
    if not isinstance(kept, np.ndarray) or kept.dtype != target.dtype or kept.shape != target.shape:
        raise ValueError(f"expected numbers of the shape {target.shape}, found {getattr(kept, 'shape', kept)!r}")
    target[:] = kept


class RowJournal(Protocol):
    """A file to which an observer adds rows, so that its state need not hold them all."""

    def append(self, rows: Array) -> None:
        """Add rows (rows, width)."""

    def read(self) -> Iterator[Array]:
        """All rows so far, some thousand at a time, each of (rows, width)."""


@runtime_checkable
class Journaled(Stateful, Protocol):
    """An observer that keeps each row, or many: they go into a journal, once, and not into each checkpoint."""

    @property
    def journal_width(self) -> int:
        """Numbers in a row of the journal."""

    def use_journal(self, journal: RowJournal) -> None:
        """Add rows to this journal from now on; :meth:`load_state` finds those of before in it."""
