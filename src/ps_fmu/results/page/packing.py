"""How arrays go into the page: as base64, in the form that its scripts read."""

from __future__ import annotations

import base64

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def encode(values: Array) -> str:
    """Base64 of the values as little-endian float32, row by row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def encode_levels(levels: Array, lowest: float) -> str:
    """Base64 of values from ``lowest`` to 0 as bytes from 0 to 255, row by row."""
    steps = np.rint(255.0 * (1.0 - np.clip(levels / lowest, 0.0, 1.0)))
    return base64.b64encode(steps.astype(np.uint8).tobytes()).decode("ascii")
