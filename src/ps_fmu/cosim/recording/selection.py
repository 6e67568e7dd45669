"""Which outputs are stored: patterns on their names, ``component.variable``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from fnmatch import fnmatchcase

from ..errors import UsageError
from ..structure import suggest_names

_ENDS = re.compile(r"\.\w+$"), re.compile(r"_\d+$")  # of a vector's components


def select_names(names: Iterable[str], patterns: Sequence[str]) -> list[str]:
    """The names that a pattern matches, in the order of ``names``; all of them if there are no patterns.

    >>> select_names(["plant.los.x", "plant.los.y", "isolator.saturated"], ["plant.los.*"])
    ['plant.los.x', 'plant.los.y']
    >>> select_names(["plant.los.x", "plant.los.y", "isolator.saturated"], ["plant.los"])
    ['plant.los.x', 'plant.los.y']

    Parameters
    ----------
    names: of the outputs, ``component.variable``.
    patterns: ``*`` stands for any text, ``?`` for a letter, ``[ab]`` for one of these; upper and lower case differ.  A
        name stands for itself, whatever brackets it has, and that of a vector for its components.

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
    """Whether a pattern stands for a name, or for that of its vector."""
    return any(one == pattern or fnmatchcase(one, pattern) for one in _list_own_names(name))


def _list_own_names(name: str) -> Iterator[str]:
    """``plant.los.x`` and ``plant.los``, ``plant.leg_force_1`` and ``plant.leg_force``."""
    yield name
    for end in _ENDS:
        vector = end.sub("", name)
        if "." in vector:  # else it is that of the component
            yield vector


def _suggest(pattern: str, known: Sequence[str]) -> str:
    """The names that are near; else those of the components."""
    components = sorted({name.partition(".")[0] for name in known})
    return suggest_names(pattern, known) or (
        f"; outputs are named component.variable, the components are {', '.join(components) or 'none'}"
    )
