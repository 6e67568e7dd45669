"""The elements that a model lists, checked and compiled; their clocks and rings at another step size."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .buffer import Array
from .core import Elements, Map
from .elements import Element
from .guard import ModelError
from .instructions import DELAY, HOLD, SAMPLE, Finder, Instruction
from .layout import BufferLayout


class StepMap(NamedTuple):
    """What a model says of steps of one size."""

    step: float
    """s."""
    maps: tuple[Map, ...]
    """One after the other; none: rows are the outputs."""
    elements: Elements


def compile_elements(
    layout: BufferLayout, data: Array, before: Sequence[Element], after: Sequence[Element]
) -> Elements:
    """The elements before and after the map as the kernel reads them.

    Raises
    ------
    ValueError: an element is wrong; the text names model, element and field.
    ModelError: what an element keeps in memory is impossible.
    """
    find = Finder(layout, data)
    return Elements(*(_compile(f"{layout.model}.{name}", elements, find) for name, elements in (
        ("before_map", before), ("after_map", after),
    )))  # fmt: skip


def _compile(where: str, elements: Sequence[Element], find: Finder) -> list[Instruction]:
    compiled = []
    for element in elements:
        if not isinstance(element, Element):
            raise TypeError(f"{where} contains a {type(element).__name__}; expected elements")
        try:
            compiled.append(element.instruct(find))
        except ModelError:
            raise
        except ValueError as error:
            raise ValueError(f"{where}: {type(element).__name__}.{error}") from None
    return compiled


def change_step(elements: Elements, data: Array, old: float, new: float) -> None:
    """Have the clocks and rings of elements, which count steps of ``old`` (s), count steps of ``new`` (s).

    Raises ModelError if that leads to numbers that are not finite.
    """
    with np.errstate(all="ignore"):
        for element in (*elements.before, *elements.after):
            if element.kind in (SAMPLE, HOLD):
                data[element.clock] *= old / new
            elif element.kind == DELAY:
                _resample(element, data, new / old)
    if not np.isfinite(data).all():
        raise ModelError(f"the step size cannot change from {old:g} s to {new:g} s: what is kept becomes infinite")


def _resample(delay: Instruction, data: Array, ratio: float) -> None:
    """The same past on another grid, whose steps are ``ratio`` times as long, by linear interpolation."""
    assert delay.second is not None
    longest = delay.n_source
    ring = data[delay.second].reshape(longest, delay.n)
    ages = np.arange(longest)
    newest_first = ring[(int(data[delay.clock]) - 1 - ages) % longest]
    past = np.stack([np.interp(ages * ratio, ages, column, right=0.0) for column in newest_first.T], axis=1)
    data[delay.second] = past[::-1].ravel()
    data[delay.clock] = 0.0
