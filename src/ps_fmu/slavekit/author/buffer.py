"""The numbers and texts of one slave: storage, typed access by name and by value reference."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .guard import Refused
from .layout import BufferLayout
from .variables import Port, Value

Array = NDArray[np.float64]

ALIGNMENT = 64  # bytes: a cache line, and the widest vector register
_PYTHON_TYPES = {"Real": float, "Integer": int, "Boolean": bool, "String": str}


def allocate_aligned(*shape: int) -> Array:
    """Zeros that start on a cache line: sums in BLAS then do not depend on where malloc put an array."""
    n = math.prod(shape)
    raw = np.zeros(n + ALIGNMENT // 8)
    first = (-raw.__array_interface__["data"][0] % ALIGNMENT) // 8
    return raw[first : first + n].reshape(shape)


def copy_aligned(matrix: Array) -> Array:
    """A copy that starts on a cache line, C-contiguous as numpy's fastest product wants it."""
    copy = allocate_aligned(*matrix.shape)
    copy[:] = matrix
    return copy


class Buffer:
    """All values of one slave, laid out as its :class:`BufferLayout` says.

    ``data`` is allocated once; everything else is a view of it.
    """

    def __init__(self, layout: BufferLayout) -> None:
        self.layout = layout
        self.data = allocate_aligned(layout.size)
        self.strings = [str(port.start) for port in layout.strings]
        self._groups: dict[str, list[int]] = {}
        for reference, port in layout.by_reference.items():
            if port.causality != "output" and reference < layout.size:
                self.data[reference] = float(port.start)

    def raw(self, reference: int) -> float | str:
        """The stored value of a variable: a double, or a text."""
        size = self.layout.size
        return self.strings[reference - size] if reference >= size else float(self.data[reference])

    def typed(self, reference: int) -> Value:
        """The value of a variable as its own type."""
        convert: type = _PYTHON_TYPES[self.layout.by_reference[reference].type]
        value: Value = convert(self.raw(reference))
        return value

    def store(self, reference: int, value: Value) -> None:
        """Store a value that :meth:`Port.checked` let pass."""
        if isinstance(value, str):
            self.strings[reference - self.layout.size] = value
        else:
            self.data[reference] = value

    def group(self, names: str | Sequence[str]) -> list[int]:
        """References of several numeric variables, as :meth:`BufferLayout.group`; texts are looked up once."""
        if not isinstance(names, str):
            return self.layout.group(names)
        if names not in self._groups:
            self._groups[names] = self.layout.group(names)
        return self._groups[names]

    def view(self, names: str | Sequence[str]) -> Array:
        """Live view of several numeric variables that lie side by side; ValueError if they do not."""
        references = self.group(names)
        first = references[0]
        if references != list(range(first, first + len(references))):
            raise ValueError(f"{self.layout.model}: {names!r} do not lie side by side")
        return self.data[first : first + len(references)]

    def ports(self, kind: str, references: Sequence[int]) -> list[Port]:
        """The ports of these value references; Refused unless all exist and are of the FMI type ``kind``."""
        ports = []
        for reference in references:
            port = self.layout.by_reference.get(reference)
            if port is None:
                # pythonfmu's library passes references from 2^31 on as negative numbers.
                raise Refused(f"there is no variable with value reference {reference % 2**32}")
            if port.type != kind:
                raise Refused(f"{port.name} (value reference {reference}) is a {port.type}, not a {kind}")
            ports.append(port)
        return ports
