"""Warnings of a run whose components describe different mechanisms."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from itertools import groupby

from ..cosim import Value
from ..cosim.structure import parse_port
from ..interface.agreement import APART, Difference, find_differences
from .setup import NOISE, RunSystem

MOST_SHOWN = 6  # quantities with their values, those that differ most; the others by name


def list_mismatches(system: RunSystem, values: Mapping[str, Value], apart: Iterable[str] = ()) -> Iterator[str]:
    """A text for each component that knows the plant otherwise than it is: the quantities, both values, what to do.

    The disturbance source is passed over where its noise is off: only that acts at the centre of mass of the bus.

    Parameters
    ----------
    values: what a case sets, by ``component.variable``.
    apart: beginnings of names that differ on purpose.  Parameters with the annotation :data:`.agreement.APART` do, too.
    """
    prefixes = tuple(apart)

    def get_value(name: str) -> Value:
        return values[name] if name in values else system.get_start(name)

    def is_meant(name: str) -> bool:
        port = system.structure.find_port(name)
        entry = system.structure.component(port.component).parameters.get(port.variable)
        noted = entry is not None and APART in entry.notes and name not in values
        return noted or any(name == prefix or name.startswith((f"{prefix}.", f"{prefix}_")) for prefix in prefixes)

    found = find_differences(system.descriptions, get_value, is_meant)
    for component, differences in groupby(found, key=lambda difference: difference.component):
        if component != parse_port(NOISE).component or get_value(NOISE):
            yield _describe(component, list(differences))


def _describe(component: str, differences: list[Difference]) -> str:
    largest_first = sorted(differences, key=lambda difference: -difference.relative)
    shown, rest = largest_first[:MOST_SHOWN], largest_first[MOST_SHOWN:]
    named = "; ".join(str(difference) for difference in shown)
    others = dict.fromkeys(re.sub(r"_\d+", "_i", difference.quantity) for difference in rest)
    more = f"; and {len(rest)} more: {', '.join(others)}" if rest else ""
    meant = component if len(differences) > 1 else f"{component}.{differences[0].quantity}"
    return (
        f"{component} describes another mechanism than the plant. {named}{more}. Set both alike in a parameter file "
        f"(ps-fmu parameters writes the values of all FMUs from one file); if it is meant, say --apart {meant}"
    )
