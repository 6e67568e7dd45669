"""Typed access to a table of a TOML file: every error names file, table and key, and no key is overlooked."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

from ..cosim.structure import suggest_names
from .numbers import Number, parse_number
from .study import StudyError

_ABSENT = object()


@dataclass
class TableReader:
    """A table; ``place`` names it in messages."""

    place: str
    table: Mapping[str, Any]

    def error(self, key: str, problem: str) -> StudyError:
        """The error that names the place and the key."""
        return StudyError(f"{self.place}, {key}: {problem}")

    def refuse_others(self, known: Collection[str], why: str = "") -> None:
        """Raises :class:`.study.StudyError` for a key that is not ``known``; ``why`` says when it is not."""
        for key in self.table:
            if key not in known:
                hint = suggest_names(key, known) or f"; known are {', '.join(known)}"
                raise self.error(key, f"unknown{why}{hint}")

    def __contains__(self, key: str) -> bool:
        return key in self.table

    def _get(self, key: str, default: object) -> Any:
        if key in self.table:
            return self.table[key]
        if default is _ABSENT:
            raise self.error(key, f"is missing{suggest_names(key, self.table)}")
        return default

    def text(self, key: str, default: object = _ABSENT) -> Any:
        """A text of one line."""
        value = self._get(key, default)
        if key in self.table and not _is_line(value):
            raise self.error(key, f"expected a text of one line, got {value!r}")
        return value

    def names(self, key: str, default: object = _ABSENT) -> tuple[str, ...]:
        """A name, or a list of names that differ."""
        value = self._get(key, default)
        names = list(value) if isinstance(value, list | tuple) else [value]
        if key in self.table and (not names or not all(map(_is_line, names)) or len(set(names)) < len(names)):
            raise self.error(key, f"expected a name, or a list of names that differ, got {value!r}")
        return tuple(names)

    def choice(self, key: str, choices: Collection[str], default: object = _ABSENT) -> str:
        """One of a few texts."""
        value = self._get(key, default)
        if value not in choices:
            hint = suggest_names(value, choices) if isinstance(value, str) else ""
            raise self.error(key, f"expected one of {', '.join(choices)}, got {value!r}{hint}")
        return str(value)

    def whole(self, key: str, low: int, high: int, default: object = _ABSENT) -> Any:
        """A whole number from ``low`` to ``high``."""
        value = self._get(key, default)
        if key in self.table and (isinstance(value, bool) or not isinstance(value, int) or not low <= value <= high):
            raise self.error(key, f"expected a whole number from {low} to {high}, got {value!r}")
        return value

    def flag(self, key: str, default: bool) -> bool:
        """True or false."""
        value = self._get(key, default)
        if not isinstance(value, bool):
            raise self.error(key, f"expected true or false, got {value!r}")
        return value

    def number(self, key: str) -> Number:
        """A number with its unit."""
        try:
            return parse_number(self._get(key, _ABSENT))
        except ValueError as error:
            raise self.error(key, str(error)) from error

    def time(self, key: str, default: object = _ABSENT, *, positive: bool = True) -> Any:
        """A time, s; above 0 where it must be positive."""
        if key not in self.table and default is not _ABSENT:
            return default
        number = self.number(key)
        try:
            value = number.to("s")
        except ValueError as error:
            raise self.error(key, f"expected a time: {error}") from error
        if value < 0.0 or (positive and value == 0.0):
            raise self.error(key, f"expected a time above 0 s, got {number}")
        return value


def _is_line(value: object) -> bool:
    return isinstance(value, str) and bool(value.strip()) and value.isprintable()
