"""A number with its unit as a study states it, of either sign or zero: ``-1.5 mm``, ``0 m``, ``2 %``."""

from __future__ import annotations

import math
import re
import sys
from dataclasses import dataclass

from ..slavekit.author.units import parse_unit

_NUMBER = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")


@dataclass(frozen=True)
class Number:
    """A finite number; ``unit`` is "" where none is given."""

    value: float
    unit: str

    def to(self, unit: str) -> float:
        """The number in another unit; "1" and "" are those of numbers without dimension.

        Raises ``ValueError`` where the two do not fit; a number without unit fits only a variable without one.
        """
        if unit in ("", "-"):
            unit = "1"
        if self.unit == unit:  # also for units that are not read here
            return self.value
        own, other = parse_unit(self.unit or "1"), parse_unit(unit)
        if own is None or own.offset:
            more = "" if unit == "1" else f"; the variable has the unit {unit!r}"
            raise ValueError(
                f"the unit {self.unit!r} is not known; known are SI units, urad, um, deg, rpm, % and others{more}"
            )
        if other is None or other.offset:
            raise ValueError(f"nothing can be converted to the unit {unit!r}: write '{self.value:g} {unit}'")
        if own.exponents != other.exponents:
            if unit == "1":
                raise ValueError(f"{self.unit!r} does not fit a number without unit: write for example {self.value:g}")
            given = repr(self.unit) if self.unit else "a number without unit"
            raise ValueError(f"{given} does not fit the unit {unit!r}: write for example '{self.value:g} {unit}'")
        return self.value * own.scale / other.scale

    def __str__(self) -> str:
        return f"{self.value:g} {self.unit}".rstrip()


def parse_number(given: object) -> Number:
    """A number from a text with its unit, or a plain number for what has no unit.

    Whether the unit is known shows when it is converted.  Raises ``ValueError`` for anything else: no number, or one
    that is not finite.
    """
    if isinstance(given, int | float) and not isinstance(given, bool):
        try:
            value, unit = float(given), ""
        except OverflowError:
            raise ValueError(f"expected a number up to {sys.float_info.max:.2g}, got {given!r:.20}...") from None
    else:
        found = _NUMBER.fullmatch(given) if isinstance(given, str) else None
        if found is None:
            raise ValueError(f"expected a number with its unit, such as '0.5 kg', got {given!r}")
        value, unit = float(found[1]), found[2] or ""
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {given!r}")
    return Number(value, unit)
