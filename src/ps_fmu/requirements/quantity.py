"""Numbers with units, times and lists of names as the files of requirements and studies state them."""

from __future__ import annotations

import math
import re
import sys
from typing import Any

from ..cosim.structure import suggest_names
from ..slavekit.author.units import SYMBOLS, parse_unit

SMALLEST, LARGEST = 1e-50, 1e50
"""Magnitudes whose squares and ratios are finite numbers, in any unit."""

_QUANTITY = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*?)?\s*")


class Quantity:
    """A finite number and its unit; ``unit`` is "" where none is given."""

    def __init__(self, value: float, unit: str) -> None:
        self.value, self.unit = value, unit

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Quantity) and (self.value, self.unit) == (other.value, other.unit)

    def __hash__(self) -> int:
        return hash((self.value, self.unit))

    def to(self, unit: str) -> float:
        """The number in another unit; "1", "-" and "" are those of numbers without dimension.

        Raises ``ValueError`` where the two do not fit; a number without unit fits only a variable without one.
        """
        if unit in ("", "-"):
            unit = "1"
        if self.unit == unit:  # also for units that are not read here
            return self.value
        own, other = parse_unit(self.unit or "1"), parse_unit(unit)
        if own is None or own.offset:
            known = "; known are SI units, deg, arcsec, mas, urad, um, ms, % and others"
            hint, more = suggest_names(self.unit, SYMBOLS) or known, f"; expected one for {unit!r}" * (unit != "1")
            raise ValueError(f"the unit {self.unit!r} is not known{hint}{more}")
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


class Limit(Quantity):
    """A number above 0 with a known unit; one without dimension has the unit ``1`` or ``%``."""


class Time(float):
    """A time above 0, s."""


class Delay(float):
    """A time of 0 or more, s."""


class Line(str):
    """A text of one line that is not blank."""


class Names(tuple[str, ...]):
    """A name or more, all different; a file may state one as a text."""


def parse_quantity(given: object) -> Quantity:
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
        found = _QUANTITY.fullmatch(given) if isinstance(given, str) else None
        if found is None:
            raise ValueError(f"expected a number with its unit, such as '0.5 kg', got {given!r}")
        value, unit = float(found[1]), found[2] or ""
    if not math.isfinite(value):
        raise ValueError(f"expected a finite number, got {given!r}")
    return Quantity(value, unit)


def parse_limit(given: object) -> Limit:
    """A limit from a text such as ``0.5 urad``.

    Raises ``ValueError`` for anything else: no text, no unit, an unknown one, a number that is not above 0.
    """
    found = parse_quantity(given)
    if not found.unit:
        raise ValueError(f"{given!r} has no unit: write for example '{found.value:g} urad', or '{found.value:g} 1'")
    unit = parse_unit(found.unit)
    if unit is None or unit.offset:
        found.to("1")  # raises that it is not known
    elif not SMALLEST <= found.value * unit.scale <= LARGEST:
        raise ValueError(f"expected a number above 0 that can be computed with, got {given!r}")
    return Limit(found.value, found.unit)


def make_value(kind: type, given: Any) -> Any:
    """A value of one of the classes here from what a file states: the hook of :mod:`ps_fmu.cosim.documents`.

    Raises ``ValueError`` with what was expected.
    """
    if kind is Quantity:
        return parse_quantity(given)
    if kind is Limit:
        return parse_limit(given)
    if kind in (Time, Delay):
        time = parse_quantity(given).to("s")
        if time < 0.0 or (kind is Time and time == 0.0):
            raise ValueError(f"expected a time {'above' if kind is Time else 'of at least'} 0 s, got {given!r}")
        return kind(time)
    if kind is Line:
        if not _is_line(given):
            raise ValueError(f"expected a text of one line, got {given!r}")
        return Line(given)
    if kind is Names:
        names = list(given) if isinstance(given, list | tuple) else [given]
        if not names or not all(map(_is_line, names)) or len(set(names)) < len(names):
            raise ValueError(f"expected a name, or a list of names that differ, got {given!r}")
        return Names(names)
    raise TypeError(f"nothing makes a {kind.__name__} of {given!r}")


def _is_line(value: object) -> bool:
    """Whether a value is a text of one line that is not blank."""
    return isinstance(value, str) and bool(value.strip()) and value.isprintable()
