"""What happens to a value on its way.

A path is a sequence of hops, from connector to connector or through a parameter mapping.  :func:`combine` turns it into
one :class:`.hops.Conversion`, which is all that a simulation needs.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from fmpy.model_description import ModelDescription, ModelVariable

from .hops import Conversion, End, Hop, Transformation
from .units import find_conversion, find_fmu_unit
from .values import EXPECTED, fits_int32, parse_value

INTEGERS = ("Integer", "Enumeration")
_VALID_FOR = {"Linear": ("Real",), "Boolean": ("Boolean",), "Integer": INTEGERS, "Enumeration": ("Enumeration",)}


def find_end(variable: ModelVariable, description: ModelDescription) -> End:
    """What an FMU says of a variable."""
    declared = variable.declaredType
    items = {item.name: int(item.value) for item in declared.items} if declared is not None and declared.items else None
    return End(variable.type, find_fmu_unit(variable, description), items)


def combine(start: End, hops: Sequence[Hop], end: End) -> Conversion:
    """The conversion of a path from ``start`` over some hops; the last of them ends at ``end``.

    A connector that states no unit has that of the next one on the way that does.  Raises ValueError with the reason,
    which begins with the place: units that cannot be converted, a transformation of another type, an unknown item,
    factors whose product is no finite number.
    """
    factor, offset = 1.0, 0.0
    tables: list[Mapping[int, int]] = []
    here = start
    for place, hop in enumerate(hops):
        there = end if place == len(hops) - 1 else _look_ahead([*(h.end for h in hops[place:-1]), end])
        try:
            scale, shift = find_conversion(here.unit, there.unit) if hop.converts else (1.0, 0.0)
            factor, offset = scale * factor, scale * offset + shift
            if hop.transformation is not None:
                kind = there.type or here.type or end.type
                if kind not in _VALID_FOR[hop.transformation.kind]:
                    raise ValueError(f"a transformation for {hop.transformation.kind} values cannot act on {kind}")
                if hop.transformation.kind == "Linear":
                    factor = hop.transformation.factor * factor
                    offset = hop.transformation.factor * offset + hop.transformation.offset
                else:
                    tables.append(_make_table(hop.transformation, here, there))
            if not (math.isfinite(factor) and math.isfinite(offset)):
                raise ValueError(f"all factors and offsets up to here come to {factor!r} and {offset!r}")
        except ValueError as error:
            raise ValueError(f"{hop.where}: {error}") from None
        here = End(there.type or here.type, there.unit or here.unit, there.items or here.items)
    return Conversion(factor, offset, tuple(tables))


def _look_ahead(ends: Sequence[End]) -> End:
    """The next connector, with the unit of the first that states one."""
    unit = next((end.unit for end in ends if end.unit is not None), None)
    return End(ends[0].type, unit, ends[0].items)


def _make_table(transformation: Transformation, here: End, there: End) -> dict[int, int]:
    table: dict[int, int] = {}
    for entry in transformation.entries:
        sides = []
        for text, end in zip(entry, (here, there), strict=True):
            if transformation.kind == "Enumeration":
                if end.items is None:
                    raise ValueError(f"nobody defines the enumeration with the item {text!r}")
                if text not in end.items:
                    raise ValueError(f"the enumeration has no item {text!r}; it has {', '.join(end.items)}")
                sides.append(end.items[text])
            else:
                value = parse_value(transformation.kind, text)
                if value is None:
                    raise ValueError(f"expected {EXPECTED[transformation.kind]}, got {text!r}")
                if not fits_int32(int(value)):
                    raise ValueError(f"the map entry {text} does not fit a 32-bit integer")
                sides.append(int(value))
        if sides[0] in table:
            raise ValueError(f"the source value {entry[0]!r} occurs twice")
        table[sides[0]] = sides[1]
    return table
