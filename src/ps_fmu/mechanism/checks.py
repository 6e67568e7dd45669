"""Checks of the parameter dataclasses: quantities with units, arrays that cannot change, errors with names."""

from __future__ import annotations

import reprlib
from dataclasses import field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Magnitudes between which products and quotients of six numbers are still finite and not zero: a double ends at 1e308.
SMALLEST, LARGEST = 1e-50, 1e50


class ParameterError(ValueError):
    """A parameter that cannot be used; the text starts with its name, for example ``payload.mass``."""

    def __init__(self, name: str, problem: str) -> None:
        super().__init__(f"{name}: {problem}")
        self.name = name
        self.problem = problem


def quantity(
    unit: str,
    description: str,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    display: str | None = None,
) -> Any:
    """A dataclass field with its unit and description, for a number also its bounds and the unit to display it in."""
    bounds = {"above": above, "at_least": at_least, "at_most": at_most}
    return field(metadata={"unit": unit, "description": description, "bounds": bounds, "display": display})


def frozen(value: Any, shape: tuple[int, ...], name: str) -> Array:
    """A read-only array of numbers up to LARGEST.  Raises ParameterError, naming ``name``, for anything else."""
    try:
        array = np.array(value, dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise ParameterError(name, f"expected numbers of shape {shape}, got {reprlib.repr(value)}") from error
    if array.shape != shape:
        raise ParameterError(name, f"expected shape {shape}, got {array.shape}")
    if not np.isfinite(array).all():
        raise ParameterError(name, f"every number must be finite, got {array.tolist()}")
    if (np.abs(array) > LARGEST).any():
        raise ParameterError(name, f"no number may be beyond {LARGEST:g}, got {array.tolist()}")
    array.setflags(write=False)
    return array


def number(
    value: Any, name: str, *, above: float | None = None, at_least: float | None = None, at_most: float | None = None
) -> float:
    """A number within bounds, zero or of a magnitude that can be multiplied.

    Raises ParameterError, naming ``name``, for anything else.
    """
    if isinstance(value, bool) or not isinstance(value, (int, float, np.floating, np.integer)):
        raise ParameterError(name, f"expected a number, got {reprlib.repr(value)}")
    try:
        result = float(value)
    except OverflowError as error:  # TOML has whole numbers of any length
        raise ParameterError(name, f"expected a number up to {LARGEST:g}, got {reprlib.repr(value)}") from error
    if not np.isfinite(result):
        raise ParameterError(name, f"must be finite, got {result}")
    if above is not None and not result > above:
        raise ParameterError(name, f"must be greater than {above:g}, got {result:g}")
    if at_least is not None and result < at_least:
        raise ParameterError(name, f"must not be less than {at_least:g}, got {result:g}")
    if at_most is not None and result > at_most:
        raise ParameterError(name, f"must not be more than {at_most:g}, got {result:g}")
    if result and not SMALLEST <= abs(result) <= LARGEST:
        raise ParameterError(name, f"expected a magnitude from {SMALLEST:g} to {LARGEST:g}, got {result:g}")
    return result


def inertia_tensor(value: Any, name: str) -> Array:
    """A symmetric positive definite inertia whose principal moments satisfy the triangle inequality."""
    array = frozen(value, (3, 3), name)
    if not np.allclose(array, array.T, rtol=0.0, atol=1e-9 * np.abs(array).max()):
        raise ParameterError(name, f"must be symmetric, got {array.tolist()}")
    moments = np.linalg.eigvalsh(array)
    if moments[0] < SMALLEST:
        raise ParameterError(name, f"must be positive definite; its principal moments are {moments.tolist()} kg.m2")
    if moments[2] > (moments[0] + moments[1]) * (1.0 + 1e-9):
        raise ParameterError(
            name,
            f"no rigid body has the principal moments {moments.tolist()} kg.m2: "
            "the largest exceeds the sum of the others",
        )
    return array


def truth(value: Any, name: str) -> bool:
    """A truth value, also given as 0 or 1.  Raises ParameterError, naming ``name``, for anything else."""
    if value not in (False, True):
        raise ParameterError(name, f"expected true or false, got {reprlib.repr(value)}")
    return bool(value)


class Checked:
    """Base of the parameter classes, whose ``__post_init__`` checks each field and stores it in its own type."""

    def _set(self, name: str, value: object) -> None:
        object.__setattr__(self, name, value)

    def _numbers(self, *names: str) -> None:
        """Check fields against the bounds that their :func:`quantity` states."""
        for f in fields(self):  # type: ignore[arg-type]  # every subclass is a dataclass
            if f.name in names:
                self._set(f.name, number(getattr(self, f.name), f.name, **f.metadata["bounds"]))
