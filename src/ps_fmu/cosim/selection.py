"""Which outputs are stored: patterns on their names, ``component.variable``."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase

from .errors import UsageError
from .structure import suggest_names


def select_names(names: Iterable[str], patterns: Sequence[str]) -> list[str]:
    """The names that a pattern matches, in the order of ``names``; all of them if there are no patterns.

    >>> select_names(["plant.los.x", "plant.los.y", "isolator.saturated"], ["plant.los.*"])
    ['plant.los.x', 'plant.los.y']

    Parameters
    ----------
    names: of the outputs, ``component.variable``.
    patterns: ``*`` stands for any text, ``?`` for a letter, ``[ab]`` for one of these; upper and lower case differ.  A
        name stands for itself, whatever brackets it has.

    Raises :class:`UsageError` for a pattern that matches no name, with those that are near.
    """
    known = list(names)
    if not patterns:
        return known
    found: set[str] = set()
    for pattern in patterns:
        matched = [name for name in known if matches(name, pattern)]
        if not matched:
            raise UsageError(f"no output matches {pattern!r}{_suggest(pattern, known)}")
        found.update(matched)
    return [name for name in known if name in found]


def matches(name: str, pattern: str) -> bool:
    """Whether a pattern stands for a name."""
    return name == pattern or fnmatchcase(name, pattern)


def _suggest(pattern: str, known: Sequence[str]) -> str:
    """The names that are near; else those of the components."""
    components = sorted({name.partition(".")[0] for name in known})
    return suggest_names(pattern, known) or (
        f"; outputs are named component.variable, the components are {', '.join(components) or 'none'}"
    )
