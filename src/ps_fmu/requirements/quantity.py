"""A number with its unit as a requirement states it, ``0.5 urad`` or ``20 ms``, and its value in other units."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

from ..cosim.structure import suggest_names
from ..slavekit.author.units import SYMBOLS, parse_unit

SMALLEST, LARGEST = 1e-50, 1e50
"""Magnitudes whose squares and ratios are finite numbers, in any unit."""

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")


@dataclass(frozen=True)
class Quantity:
    """A positive number and its unit."""

    value: float
    unit: str

    def to(self, unit: str) -> float:
        """The number in another unit.  Raises ``ValueError`` where the two do not fit, or ``unit`` cannot be read."""
        own, other = parse_unit(self.unit), parse_unit("1" if unit in ("", "-") else unit)
        assert own is not None  # parse_quantity takes no other
        if other is None or other.offset:
            raise ValueError(f"nothing can be converted to the unit {unit!r}")
        if own.exponents != other.exponents:
            raise ValueError(f"{self.unit!r} does not fit the unit {unit!r}")
        return self.value * own.scale / other.scale

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}"


def parse_quantity(text: object, example: str = "0.5 urad") -> Quantity:
    """A quantity from a text such as ``0.5 urad``; one without dimension has the unit ``1`` or ``%``.

    ``example`` is what messages show.

    Raises ``ValueError`` for anything else: no text, no unit, an unknown one, a number that is not above 0.
    """
    if not isinstance(text, str):
        raise ValueError(f"expected a number with its unit as a text, such as '{example}', got {text!r}")
    found = _QUANTITY.fullmatch(text)
    if found is None:
        raise ValueError(f"expected a number with its unit, such as '{example}', got {text!r}")
    if found[2] is None:
        none = f", or '{found[1]} 1' for none" if example.endswith("rad") else ""
        raise ValueError(f"{text!r} has no unit: write for example '{found[1]} {example.split()[1]}'{none}")
    unit = parse_unit(found[2])
    if unit is None or unit.offset:
        hint = suggest_names(found[2], SYMBOLS) or "; known are SI units, deg, arcsec, mas, urad, um, ms, % and others"
        raise ValueError(f"the unit {found[2]!r} is not known{hint}")
    value = float(found[1])
    if not (math.isfinite(value) and SMALLEST <= value * unit.scale <= LARGEST):
        raise ValueError(f"expected a number above 0 that can be computed with, got {text!r}")
    return Quantity(value, found[2])
