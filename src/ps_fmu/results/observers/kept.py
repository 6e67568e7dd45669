"""States of observers for checkpoints: their attributes that change during a run, saved and loaded by name."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

State = Mapping[str, Any]
"""Numbers, texts, arrays, None, and lists and dicts of such, by name."""


def save_attributes(owner: object, names: Sequence[str]) -> dict[str, Any]:
    """Attributes by name, without leading underscore; those that have a state of their own by that.

    Arrays are not copied.
    """
    return {name.lstrip("_"): _save(getattr(owner, name)) for name in names}


def load_attributes(owner: object, names: Sequence[str], state: State, growing: Collection[str] = ()) -> None:
    """Set attributes from a state of :func:`save_attributes`.

    Each has to be of the type that it has now, an array of the same dtype and shape; the first dimension of those that
    are ``growing`` may be another.  Raises KeyError for one that is missing, ValueError for one that does not fit.
    """
    for name in names:
        setattr(owner, name, _load(name.lstrip("_"), state[name.lstrip("_")], getattr(owner, name), name in growing))


def check_array(name: str, found: Any, like: NDArray[Any], *, grows: bool = False) -> NDArray[Any]:
    """The array, if it has the dtype and shape of another one, but perhaps for its length.  Raises ValueError."""
    fits = isinstance(found, np.ndarray) and found.dtype == like.dtype and found.ndim == like.ndim
    if not fits or found.shape[grows:] != like.shape[grows:]:
        what = f"{found.dtype} {found.shape}" if isinstance(found, np.ndarray) else type(found).__name__
        raise ValueError(f"{name}: expected an array {like.dtype} {like.shape}, found {what}")
    return np.array(found)


def _save(value: Any) -> Any:
    if isinstance(value, list):
        return [_save(one) for one in value]
    return value.save_state() if hasattr(value, "save_state") else value


def _load(name: str, found: Any, present: Any, grows: bool) -> Any:
    if hasattr(present, "load_state"):
        present.load_state(found)
        return present
    if isinstance(present, np.ndarray):
        return check_array(name, found, present, grows=grows)
    if type(found) is not type(present) or (isinstance(present, list) and len(found) != len(present)):
        raise ValueError(f"{name}: expected {type(present).__name__} as before, found {found!r}")
    if isinstance(present, list):
        return [_load(name, one, own, grows) for one, own in zip(found, present, strict=True)]
    return found
