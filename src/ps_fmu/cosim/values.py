"""Values as XML writes them (XML Schema Part 2), and what may happen to them on their way, as data."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

Value = float | int | bool | str
"""What a variable may have: Real, Integer (and the number of an item of an Enumeration), Boolean or String."""

_REAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_INTEGER = re.compile(r"[+-]?\d+")
_BOOLEAN = {"true": True, "1": True, "false": False, "0": False}
MOST_DIGITS = 300
"""Of a whole number that is read: it is out of range anyway, and thousands take long."""
EXPECTED = {"Real": "a finite number", "Integer": "a whole number", "Boolean": "true or false"}


def parse_real(text: str) -> float | None:
    """A finite decimal number, or None."""
    stripped = text.strip()
    value = float(stripped) if _REAL.fullmatch(stripped) else math.nan
    return value if math.isfinite(value) else None


def parse_value(kind: str, text: str) -> Value | None:
    """A value of an FMI type (Real, Integer, Boolean or String), or None for a text that is none."""
    stripped = text.strip()
    if kind == "Real":
        return parse_real(text)
    if kind == "Integer":
        return int(stripped) if _INTEGER.fullmatch(stripped) and len(stripped) <= MOST_DIGITS else None
    if kind == "Boolean":
        return _BOOLEAN.get(stripped)
    return text


def fits_int32(value: int) -> bool:
    """Whether a whole number is one of FMI 2.0, which has 32 bits."""
    return -(2**31) <= value < 2**31


# ---- the way of a value: units, the transformations of SSP 1.0, section 4.5.2 ---------------------------------------


EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
Items = Mapping[str, int]
"""Values of an enumeration by the names of its items."""



def list_items(items: Items) -> str:
    """The items of an enumeration with their values, for messages."""
    return ", ".join(f"{name} ({value})" for name, value in items.items())


@dataclass(frozen=True)
class Unit:
    """A unit; ``exponents`` of :data:`EXPONENTS`, None where a file only names the unit."""

    name: str
    exponents: tuple[float, ...] | None = None
    factor: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Transformation:
    """``kind`` is Linear (``factor``, ``offset``), Boolean, Integer or Enumeration (``entries``: source, target)."""

    kind: str
    factor: float = 1.0
    offset: float = 0.0
    entries: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True)
class End:
    """What is known of a value at one place; None where nothing is stated."""

    type: str | None = None
    unit: Unit | None = None
    items: Items | None = None


@dataclass(frozen=True)
class Hop:
    """A step of a path: first the units are converted, if ``converts``, then the value is transformed."""

    where: str
    end: End = End()
    transformation: Transformation | None = None
    converts: bool = True


@dataclass(frozen=True)
class Conversion:
    """``factor * v + offset`` for a Real; for another value one table after the other, what is not in it stays."""

    factor: float = 1.0
    offset: float = 0.0
    tables: tuple[Mapping[int, int], ...] = ()

    @property
    def changes_nothing(self) -> bool:
        """Whether it is the identity."""
        return (self.factor, self.offset) == (1.0, 0.0) and not self.tables

    def apply(self, value: Value) -> Value:
        """A value behind the conversion."""
        if isinstance(value, float):
            return value if self.changes_nothing else self.factor * value + self.offset
        if isinstance(value, str) or not self.tables:
            return value
        kind, number = type(value), int(value)
        for table in self.tables:
            number = table.get(number, number)
        return kind(number)
