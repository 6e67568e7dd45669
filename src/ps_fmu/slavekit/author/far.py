"""Errors from a model's arithmetic name the values that are so far from the usual that it cannot work.

A double reaches to 1e308, but a product of a few such numbers does not.  What fails then, and where, depends on the
model: an overflow, a division by zero, eigenvalues that do not converge.  No model can foresee all of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import log10
from typing import NamedTuple

from .buffer import Array, BufferLayout
from .guard import ModelError, Refused

FAR = 1e6  # factor; the arithmetic of the default system fails from 1e8 on
_MOST = 3  # of such values in a message


def blame(error: BaseException, layout: BufferLayout, data: Array, step: float, usual_step: float) -> None:
    """Raise ModelError in place of an error that may come from values far from the usual, unless it says so itself.

    Parameters
    ----------
    data: a buffer with what led to the error: inputs, parameters, memory; where none of these is far, states
    step, usual_step: step size, 0 if none was made, and what the model says it usually is [s]
    """
    if not isinstance(error, (ArithmeticError, ValueError)):  # numpy's LinAlgError is a ValueError
        return
    text = str(error) if isinstance(error, (ModelError, Refused)) else f"{type(error).__name__}: {error}"
    # States are results, unless somebody has made them up.
    causes, states = range(layout.u.start, layout.size), range(layout.x.start, layout.x.stop)
    far = _find_far_values(layout, data, causes) or _find_far_values(layout, data, states)
    if any(name in text for name in [*(port.name for port in layout.strings), *(value.name for value in far)]):
        return
    named = [value.text for value in far]
    if step and _count_decades(step, usual_step) > log10(FAR):
        named.insert(0, f"step size {step:g} s")
    if named:
        more = " ..." if len(named) > _MOST else ""
        raise ModelError(f"{text}; far beyond what is usual: {', '.join(named[:_MOST])}{more}") from error


class _Far(NamedTuple):
    decades: float
    """Between the value and the usual one."""
    name: str
    text: str


def _find_far_values(layout: BufferLayout, data: Array, places: range) -> list[_Far]:
    """The values at these places of the buffer that are far from the usual, the farthest first."""
    return sorted(_iterate_far_values(layout, data, places), key=lambda found: -found.decades)


def _iterate_far_values(layout: BufferLayout, data: Array, places: range) -> Iterator[_Far]:
    for place in places:
        port, value = layout.by_reference.get(place), float(data[place])
        if port is not None and port.start and port.type != "Boolean":
            decades = _count_decades(value, float(port.start))
        else:  # where 0 is usual, so is any small value
            decades = log10(max(abs(value) / ((port and port.nominal) or 1.0), 1.0))
        if decades > log10(FAR):
            name, unit = layout.describe(place), port.unit if port is not None else "1"
            yield _Far(decades, name, f"{name} = {value:g} {unit}".removesuffix(" 1"))


def _count_decades(value: float, usual: float) -> float:
    return abs(log10(abs(value)) - log10(abs(usual))) if value else 0.0
