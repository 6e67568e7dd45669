"""Which columns of a run a requirement judges: each signal, or the magnitude of all."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from ..cosim.structure import suggest_names
from .requirement import Requirement


class NamedColumn(Protocol):
    """What must be known of a recorded output."""

    @property
    def name(self) -> str:
        """``component.variable``."""

    @property
    def unit(self) -> str:
        """As FMI spells it; "1" where there is none."""

    @property
    def type(self) -> str:
        """``Real``, ``Integer``, ``Enumeration`` or ``Boolean``."""


@dataclass(frozen=True)
class Target:
    """What gets a verdict of its own."""

    label: str
    places: tuple[int, ...]
    """Among the columns; more than one: the magnitude of their vector."""
    limit: float
    """In the unit of the columns."""


def find_targets(requirement: Requirement, columns: Sequence[NamedColumn]) -> tuple[Target, ...]:
    """The targets of a requirement among the columns of a run.

    Raises :class:`.requirement.RequirementError`: an unknown signal (with near names), one that is no Real, a limit
    that does not fit its unit, a magnitude of signals with different units.
    """
    places = {column.name: place for place, column in enumerate(columns)}
    found: dict[str, int] = {}
    for signal in requirement.signals:
        members = _find_members(signal, places)
        if not members:
            hint = suggest_names(signal, _list_names(places))
            raise requirement.error("signal", f"there is no output {signal!r}{hint}")
        found |= members
    limits = {}
    for name, place in found.items():
        column = columns[place]
        if column.type != "Real":
            raise requirement.error("signal", f"{name} is of the type {column.type}: expected a Real")
        try:
            limits[name] = requirement.limit.to(column.unit)
        except ValueError as error:
            raise requirement.error("limit", f"{error} of {name}") from error
    if not requirement.norm:
        return tuple(Target(name, (place,), limits[name]) for name, place in found.items())
    units = {columns[place].unit for place in found.values()}
    if len(units) > 1:
        raise requirement.error("combine", f"a magnitude of {', '.join(sorted(units))} cannot be formed")
    label = f"|{', '.join(requirement.signals)}|"
    return (Target(label, tuple(found.values()), next(iter(limits.values()))),)


def _find_members(signal: str, places: dict[str, int]) -> dict[str, int]:
    """The column of this name, or those of the vector: ``.x``, ``.roll`` or ``_1`` behind its name."""
    if signal in places:
        return {signal: places[signal]}
    if "." not in signal:  # a component is no vector
        return {}
    member = re.compile(re.escape(signal) + r"(?:\.\w+|_\d+)")
    return {name: place for name, place in places.items() if member.fullmatch(name)}


def _list_names(places: dict[str, int]) -> list[str]:
    vectors = {name[: match.start()] for name in places if (match := re.search(r"(?:\.\w+|_\d+)$", name))}
    return [*places, *sorted(name for name in vectors if "." in name)]
