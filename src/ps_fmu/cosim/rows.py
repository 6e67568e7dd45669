"""The recorded outputs: which columns there are, and the block of rows that the FMUs write into.

Real outputs come first, side by side for each component, so that ``fmi2GetReal`` can write them straight into
a row.  Integers and Booleans (C int in FMI) lie at the end of the same row.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from ..reduction.columns import complete_rows, find_peak
from .description import DISCRETE_TYPES, get_unit
from .structure import PortName
from .values import Conversion

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """A recorded output.  ``unit`` is spelled as in FMI, "1" if there is no unit."""

    name: str
    unit: str
    type: str
    description: str
    component: str = ""
    """Name of the component, where it is known."""


class OwnColumn(Protocol):
    """What lies in the rows as if it were an output."""

    @property
    def port(self) -> PortName:
        """Its name; it has no component."""

    @property
    def column(self) -> Column:
        """How it is recorded."""


class InputSignal(OwnColumn, Protocol):
    """An input of the run."""

    def sample(self, times: Array, step: float) -> Array:
        """Values at some times [s] of a run with a step [s]."""


@dataclass(frozen=True)
class Derived:
    """A column that is computed from another one, by its place, when a block is complete."""

    column: Column
    place: int
    conversion: Conversion

    def compute(self, values: Array) -> Array:
        """The values (rows,) from the rows of all columns."""
        source = values[:, self.place]
        if not self.conversion.tables:
            with np.errstate(over="ignore", invalid="ignore"):  # who looks at the rows finds what is not finite
                return source * self.conversion.factor + self.conversion.offset
        return np.array([float(self.conversion.apply(int(value))) for value in source])


@dataclass(frozen=True)
class RowLayout:
    """Where each output lies: place among the Real columns, or among the discrete ones that follow them."""

    columns: tuple[Column, ...]
    real: Mapping[PortName, int]
    discrete: Mapping[PortName, int]


def make_layout(
    descriptions: Mapping[str, ModelDescription],
    more: Collection[PortName] = (),
    signals: Sequence[OwnColumn] = (),
    only: Collection[PortName] | None = None,
) -> RowLayout:
    """Columns of all outputs of all components, in the order of the components and of their variables.

    Strings are left out: they have no place in an array of numbers.  ``more``: other variables to take in;
    ``signals`` come after the outputs of their kind, under another name where a variable has theirs; ``only``: leave
    out all other variables.
    """
    real: dict[PortName, Column] = {}
    discrete: dict[PortName, Column] = {}
    taken = set()
    for name, description in descriptions.items():
        for variable in description.modelVariables:
            port = PortName(name, variable.name)
            if (variable.causality != "output" and port not in more) or variable.type == "String":
                continue
            taken.add(str(port))
            if only is not None and port not in only:
                continue
            column = Column(str(port), get_unit(variable) or "1", variable.type, variable.description or "", name)
            (discrete if variable.type in DISCRETE_TYPES else real)[port] = column
    for signal in signals:
        column = signal.column
        if column.name in taken:  # the variable's own column has what its FMU got, as from a fault
            column = replace(column, name=f"{column.name} ({column.description})")
        (discrete if column.type in DISCRETE_TYPES else real)[signal.port] = column
    return RowLayout(
        (*real.values(), *discrete.values()),
        {port: place for place, port in enumerate(real)},
        {port: place for place, port in enumerate(discrete)},
    )


@dataclass(frozen=True, eq=False)
class Latest:
    """The outputs of one kind of numbers at the last communication point; FMUs write to it by address."""

    places: Mapping[PortName, int]
    values: NDArray[Any]


class Rows:
    """A block of ``capacity`` rows and the latest outputs, which become the next row.

    The first ``filled`` rows are complete; ``first_index`` counts row 0 from the start of the simulation.

    Integers and Booleans, C int in FMI, lie in the places of the doubles that they become when the block is
    complete (:meth:`finish`, once), so that a row is one copy.
    """

    def __init__(self, layout: RowLayout, capacity: int, derived: Sequence[Derived] = ()) -> None:
        self.capacity = capacity
        self._derived = derived
        self.filled = 0
        self.first_index = 0
        self.block: Array = np.zeros((capacity, len(layout.columns)))
        """(capacity, columns): where the next rows go."""
        self._n_real, self._n_discrete = len(layout.real), len(layout.discrete)
        self.latest: Array = np.zeros(len(layout.columns))
        self.real = Latest(layout.real, self.latest[: self._n_real])
        self.discrete = Latest(layout.discrete, self._integers(self.latest))

    def _integers(self, rows: Array) -> NDArray[np.int32]:
        """The C ints at the end of rows, a view."""
        return rows[..., self._n_real :].view(np.int32)[..., : self._n_discrete]

    def find_place(self, port: PortName) -> tuple[NDArray[Any], int]:
        """The array of latest values in which a port lies, and its place there."""
        kind = self.real if port in self.real.places else self.discrete
        return kind.values, kind.places[port]

    def store_latest(self) -> None:
        """The latest outputs are the next row."""
        self.block[self.filled] = self.latest
        self.filled += 1

    def complete(self) -> tuple[Array, float]:
        """The complete rows, see :meth:`finish`; perhaps a view that the next step overwrites."""
        return self.finish(self.block[: self.filled])

    def copy(self, count: int) -> Array:
        """The first ``count`` rows as numbers; the block stays as it is."""
        return self.finish(self.block[:count].copy())[0]

    def next_block(self) -> None:
        """Start a new block behind the last complete row."""
        filled, self.filled = self.filled, 0
        self.first_index += filled

    def restore(self, first_index: int, block: Array, latest: Array) -> None:
        """Take over the unfinished block of another run, as it lies in :attr:`block`, and its latest outputs."""
        self.block[: len(block)] = block
        self.latest[:] = latest
        self.first_index, self.filled = first_index, len(block)

    @contextmanager
    def aside(self) -> Iterator[None]:
        """During the body rows go into another block, which is forgotten after it."""
        block, filled = self.block, self.filled
        self.block, self.filled = np.empty_like(block), 0
        try:
            yield
        finally:
            self.block, self.filled = block, filled

    def finish(self, rows: Array) -> tuple[Array, float]:
        """Rows of a block as numbers, in place, derived columns last, and what :func:`.find_peak` says of them."""
        peak = complete_rows(rows, self._n_real)
        if not self._derived:
            return rows, peak
        values = np.column_stack([rows, *(item.compute(rows) for item in self._derived)])
        return values, find_peak(values)
