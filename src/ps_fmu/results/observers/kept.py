"""States of observers for checkpoints: their attributes that change during a run, saved and loaded by name."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
State = Mapping[str, Any]
"""Numbers, texts, arrays, None, and lists and dicts of such, by name."""


class RowJournal(Protocol):
    """A file of a checkpoint that grows row by row; see ``ps_fmu.cosim.checkpoint``."""

    def append(self, rows: Array) -> None:
        """Add rows (rows, width)."""

    def read(self) -> Iterator[Array]:
        """All rows so far, some thousand at a time."""


def save_attributes(owner: object, names: Sequence[str]) -> dict[str, Any]:
    """Attributes by name, without leading underscore; arrays are not copied."""
    return {name.lstrip("_"): getattr(owner, name) for name in names}


def load_attributes(owner: object, names: Sequence[str], state: State, growing: Collection[str] = ()) -> None:
    """Set attributes from a state of :func:`save_attributes`.

    Each has to be of the type that it has now, an array of the same dtype and shape; the first dimension of those that
    are ``growing`` may be another.  Raises KeyError for one that is missing, ValueError for one that does not fit.
    """
    for name in names:
        found, present = state[name.lstrip("_")], getattr(owner, name)
        if isinstance(present, np.ndarray):
            check_array(name.lstrip("_"), found, present, grows=name in growing)
        elif type(found) is not type(present):
            raise ValueError(f"{name.lstrip('_')}: expected {type(present).__name__}, found {type(found).__name__}")
        setattr(owner, name, found)


def check_array(name: str, found: Any, like: NDArray[Any], *, grows: bool = False) -> NDArray[Any]:
    """The array, if it has the dtype and shape of another one, but perhaps for its length.  Raises ValueError."""
    fits = isinstance(found, np.ndarray) and found.dtype == like.dtype and found.ndim == like.ndim
    if not fits or found.shape[grows:] != like.shape[grows:]:
        what = f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__
        raise ValueError(f"{name}: expected an array {like.dtype} {like.shape}, found {what}")
    return np.asarray(found)
