"""What the steps have in common: parameters within ranges, published targets, and what the data leave open."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from ...mechanism.parameters import Array
from ..published import published_numbers

STEPS = 20  # searches that succeed mostly take less than 15; the path of a longer one depends on rounding
LONGEST_STEP = 0.1  # of the ranges
SETTLED = 1e-9  # of the ranges: a step that no printed digit shows
# Least singular value of a Jacobian that counts, of the largest.  In most symmetric mechanisms one number of Table 1
# follows from the others, up to rounding (see report.py); to follow that rounding would mean steps without end.
LEAST_SLOPE = 1e-6


@dataclass(frozen=True)
class Range:
    """A parameter and where a plausible value lies; the fits work with its place u in the range, 0 to 1."""

    name: str
    unit: str
    low: float
    high: float
    logarithmic: bool = False

    def at(self, u: float) -> float:
        """The value at a place, in the parameter's unit."""
        if self.logarithmic:
            return float(self.low * (self.high / self.low) ** u)
        return float(self.low + u * (self.high - self.low))


def values_at(ranges: Sequence[Range], places: Sequence[float] | Array) -> list[float]:
    """Values of parameters at places in their ranges, each in its unit."""
    return [r.at(u) for r, u in zip(ranges, places, strict=True)]


@dataclass(frozen=True, eq=False)
class Identifiability:
    """What data determine of parameters, to first order at a solution."""

    jacobian: Array
    """(data, parameters): change of each number in units of its rounding, per whole range of each parameter."""

    @property
    def singular_values(self) -> Array:
        """(min(data, parameters),), largest first.

        1/sigma is how far, in ranges, the parameters can move along the singular vector before the print shows it.
        """
        return np.asarray(np.linalg.svd(self.jacobian, compute_uv=False))

    @property
    def determined(self) -> int:
        """Combinations of parameters that the print fixes to better than their whole range: sigma above 1."""
        return int(np.count_nonzero(self.singular_values > 1.0))

    @property
    def free_share(self) -> Array:
        """(parameters,), part of each parameter's direction that lies in what is not determined: 0 fixed, 1 free."""
        _, _, Vt = np.linalg.svd(self.jacobian)
        return np.asarray(np.linalg.norm(Vt[self.determined :], axis=0))


def targets(keys: Sequence[str]) -> Array:
    """Published values, in the paper's units, (n,)."""
    return np.array([published_numbers()[key].value for key in keys])


def roundings(keys: Sequence[str]) -> Array:
    """Half a unit in the last printed digit of published values, (n,)."""
    # repr() gives the digits of the file, except zeros at the end.
    digits = (Decimal(repr(value)).as_tuple().exponent for value in targets(keys).tolist())
    return np.array([0.5 * 10.0 ** int(digit) for digit in digits])


def slopes(function: Callable[[Array], Array], x: Array, step: float = 1e-6) -> Array:
    """Jacobian of ``function``, (n,) to (...), by central differences; (..., n)."""
    columns = [(function(x + h) - function(x - h)) / (2.0 * step) for h in step * np.eye(x.size)]
    return np.stack(columns, axis=-1)


def follow(error: Callable[[Array], tuple[Array, Array]], places: Array) -> Array:
    """Places (n,) in the ranges after at most :data:`STEPS` steps towards an error of zero.

    Gauss-Newton with the pseudo-inverse: each step is the shortest one that removes the error to first order, so that
    what the numbers do not fix stays near the start.

    Parameters
    ----------
    error: places (n,) -> error (m,) and its Jacobian (m, n).
    """
    for _ in range(STEPS):
        value, slope = error(places)
        move = np.linalg.pinv(slope, rcond=LEAST_SLOPE) @ -value
        longest = float(np.abs(move).max())
        if longest < SETTLED:
            break
        places = np.clip(places + move * min(1.0, LONGEST_STEP / longest), 0.0, 1.0)
    return places
