"""How data go into the page: fields by name, arrays as base64, in the form that its scripts read."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Entry = dict[str, object]


def encode(values: Array) -> str:
    """Base64 of the values as little-endian float32, row by row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def encode_levels(levels: Array, lowest: float) -> str:
    """Base64 of values from ``lowest`` to 0 as bytes from 0 to 255, row by row."""
    steps = np.rint(255.0 * (1.0 - np.clip(levels / lowest, 0.0, 1.0)))
    return base64.b64encode(steps.astype(np.uint8).tobytes()).decode("ascii")


def pack_fields(shown: Any) -> Entry:
    """The fields of a dataclass, named as in JavaScript; a field that has a ``pack`` of its own is packed by that."""
    return {_rename(field.name): _pack(getattr(shown, field.name)) for field in fields(shown)}


def _pack(value: Any) -> object:
    if hasattr(value, "pack"):
        return value.pack()
    if is_dataclass(value):
        return pack_fields(value)
    if isinstance(value, np.ndarray):
        return encode(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_pack(each) for each in value]
    return value


def _rename(name: str) -> str:
    first, *others = name.split("_")
    return first + "".join(map(str.capitalize, others))
