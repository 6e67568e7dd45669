"""The elements that a model lists, checked and compiled."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from .buffer import Array, BufferLayout
from .core import Elements, Map
from .elements import Element
from .guard import ModelError
from .instructions import DELAY_AGE, DELAY_NEWEST, DELAY_OUT, DELAY_RING, Finder, Instruction, Kind


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


def find_full_delay(elements: Elements, data: Array, step: float) -> str:
    """What to say of a delay that cannot keep another step of ``step`` (s); empty: all can."""
    for e in elements.every:
        if e.kind == Kind.DELAY:
            newest, out = (int(data[e.clock + kept]) for kept in (DELAY_NEWEST, DELAY_OUT))
            gap = data[e.clock + DELAY_RING + (out + 1) % e.n_source * (e.n + 1)]
            is_late = data[e.clock + DELAY_AGE] + step - gap >= e.time - 1e-6 * step - 1e-9 * e.time
            if (newest + 1) % e.n_source == out and not is_late:
                return f"more than {e.n_source - 1} steps lie within a delay of {e.time:g} s, which keeps no more"
    return ""
