"""The recorded outputs: which columns there are, and the block of rows that the FMUs write into.

Real outputs come first, side by side for each component, so that ``fmi2GetReal`` can write them straight into
a row.  Integers and Booleans (C int in FMI) go into a block of their own and are copied once per block.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from .description import DISCRETE_TYPES, unit_of
from .structure import Port

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """A recorded output.  ``unit`` is the FMI spelling, "1" where there is none."""

    name: str
    unit: str
    type: str
    description: str


@dataclass(frozen=True)
class Layout:
    """Where each output lies: place among the Real columns, or among the discrete ones that follow them."""

    columns: tuple[Column, ...]
    real: Mapping[Port, int]
    discrete: Mapping[Port, int]


def layout_of(descriptions: Mapping[str, ModelDescription]) -> Layout:
    """Columns of all outputs of all components, in the order of the components and of their variables.

    Strings are left out: they have no place in an array of numbers.
    """
    real: dict[Port, Column] = {}
    discrete: dict[Port, Column] = {}
    for name, description in descriptions.items():
        for variable in description.modelVariables:
            if variable.causality != "output" or variable.type == "String":
                continue
            port = Port(name, variable.name)
            column = Column(str(port), unit_of(variable) or "1", variable.type, variable.description or "")
            (discrete if variable.type in DISCRETE_TYPES else real)[port] = column
    return Layout(
        (*real.values(), *discrete.values()),
        {port: place for place, port in enumerate(real)},
        {port: place for place, port in enumerate(discrete)},
    )


class Rows:
    """A block of ``capacity`` rows behind the row that came before them, allocated once.

    ``values`` (capacity + 1, columns) and ``discrete`` (capacity + 1, discrete columns); row 0 is the row
    before the block, rows 1 to ``filled`` are complete, ``first_index`` counts row 1 from the start of the
    simulation. ``takes`` and ``addresses`` are prepared per row because making a view costs as much as an
    FMI call.
    """

    def __init__(self, layout: Layout, capacity: int) -> None:
        self.capacity = capacity
        self.values: Array = np.zeros((capacity + 1, len(layout.columns)))
        self.discrete: NDArray[np.int32] = np.zeros((capacity + 1, len(layout.discrete)), dtype=np.int32)
        self.n_real = len(layout.real)
        self.filled = 0
        self.first_index = 0
        self.takes: list[Callable[..., Any]] = [row.take for row in self.values]
        self.discrete_takes: list[Callable[..., Any]] = [row.take for row in self.discrete]
        self.addresses = _row_addresses(self.values)
        self.discrete_addresses = _row_addresses(self.discrete)

    def complete(self) -> Array:
        """The complete rows, discrete columns filled in: a view that the next step overwrites."""
        rows = slice(1, self.filled + 1)
        self.values[rows, self.n_real :] = self.discrete[rows]
        return self.values[rows]

    def next_block(self) -> None:
        """Start a new block behind the last complete row."""
        self.values[0] = self.values[self.filled]
        self.discrete[0] = self.discrete[self.filled]
        self.first_index += self.filled
        self.filled = 0


def _row_addresses(array: NDArray[Any]) -> list[int]:
    base, stride = array.ctypes.data, array.strides[0]
    return [base + row * stride for row in range(len(array))]
