"""Errors from a model's arithmetic name the values that are so far from the usual that it cannot work.

A double reaches to 1e308, but a product of a few such numbers does not.  What fails then, and where, depends on the
model: an overflow, a division by zero, eigenvalues that do not converge.  No model can foresee all of it.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import log10

from .buffer import Array
from .guard import ModelError, Refused
from .layout import Layout
from .variables import Port

FAR = 1e6  # factor; the arithmetic of the four FMUs fails from 1e8 on
_MOST = 3  # of such values in a message


def blame(error: BaseException, layout: Layout, data: Array, step: float, usual_step: float) -> None:
    """Raise ModelError in place of an error that may come from values far from the usual, unless it says so itself.

    Parameters
    ----------
    data: a buffer with the inputs and parameters that led to the error
    step, usual_step: step size, 0 if none was made, and what the model says it usually is [s]
    """
    if not isinstance(error, (ArithmeticError, ValueError)):  # numpy's LinAlgError is a ValueError
        return
    text = str(error) if isinstance(error, (ModelError, Refused)) else f"{type(error).__name__}: {error}"
    far = sorted(_far_values(layout, data), key=lambda found: -found[0])
    if any(port.name in text for port in [*layout.strings, *(port for _, port, _ in far)]):
        return
    named = [f"{port.name} = {value:g} {port.unit}".removesuffix(" 1") for _, port, value in far]
    if step and _decades(step, usual_step) > log10(FAR):
        named.insert(0, f"step size {step:g} s")
    if named:
        more = " ..." if len(named) > _MOST else ""
        raise ModelError(f"{text}; far beyond what is usual: {', '.join(named[:_MOST])}{more}") from error


def _far_values(layout: Layout, data: Array) -> Iterator[tuple[float, Port, float]]:
    """Inputs and parameters that are far from their start values: by how many decades, which, and the value."""
    for reference, port in layout.by_reference.items():
        if port.causality == "output" or port.type not in ("Real", "Integer"):
            continue
        value = float(data[reference])
        if port.start:
            decades = _decades(value, float(port.start))
        else:  # a small value is as usual as 0
            decades = log10(max(abs(value) / (port.nominal or 1.0), 1.0))
        if decades > log10(FAR):
            yield decades, port, value


def _decades(value: float, usual: float) -> float:
    return abs(log10(abs(value)) - log10(abs(usual))) if value else 0.0
