"""The way of a value as data: units, the transformations of SSP 1.0, section 4.5.2, and what they come to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from .values import Value

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
