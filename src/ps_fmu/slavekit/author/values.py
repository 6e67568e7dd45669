"""Reading and writing the variables of a slave: by name for models, by value reference for hosts."""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from collections.abc import Callable, Sequence
from math import isfinite
from typing import Any, ClassVar, TypeVar

from .buffer import Array, Buffer, find_runs
from .core import REFERENCE, make_core
from .guard import Refused, escape, guard_method
from .instructions import Finder, Places
from .layout import BufferLayout
from .model import Model
from .state import LifePhase
from .variables import Value

_MOST_LISTS = 256  # remembered lists of value references, per instance and direction

T = TypeVar("T")
Key = tuple[str | int, ...]  # FMI type, value references
Reader = Callable[[], list[Any]]
Write = tuple[Callable[..., None], Array, int, int]  # stores the values first to last - 1; their place; first; last
Writer = tuple[list[Write], list[Write], list[Write]]  # with limits; events; all


class Values(Model):
    """Typed access to one buffer.

    While stepping, hosts repeat the same few calls: the list of references of a call, checked once, leads to a
    function that reads, or to functions that store.  All else goes by ``_get`` and ``_set``.
    """

    layout: ClassVar[BufferLayout]
    native: ClassVar[bool] = True
    """False: a launcher passes all calls on to Python; for comparisons."""

    def _allocate(self) -> None:
        """The place where the arrays of an instance are made, once."""
        layout = self.layout
        self._buffer = Buffer(layout)
        data = self._buffer.data
        self._core = make_core(layout, data)
        self.y, self.x, self.u = data[layout.y], data[layout.x], data[layout.u]
        self.a, self.r, self.memory = data[layout.a], data[layout.r], data[layout.memory]
        self._phase = LifePhase.INSTANTIATED
        self._stale = True  # something was set since the last configure()
        self._forget_lists()

    # --- For models ---------------------------------------------------------------------

    def value(self, name: str) -> Value:
        """Present value of a variable, as its own type.  Raises KeyError if there is none of that name."""
        return self._buffer.typed(self.layout.find(name))

    def values(self, names: str | Sequence[str]) -> Array:
        """Copy of several numeric variables: ``"base_force"`` for its components, or full names."""
        return self._buffer.data[self._buffer.group(names)]

    def view(self, names: str | Sequence[str]) -> Array:
        """Live view of several numeric variables that lie side by side."""
        return self._buffer.view(names)

    def places(self, view: Array) -> Places:
        """Where the numbers of a view lie in the buffer: operands need not lie side by side, see :mod:`.elements`."""
        return Finder(self.layout, self._buffer.data).places("view", view)

    def parameters(self) -> dict[str, Value]:
        """All parameters by name."""
        parameters = (port for port in self.layout.ports if port.causality == "parameter")
        return {port.name: self.value(port.name) for port in parameters}

    # --- For hosts ----------------------------------------------------------------------

    def get_real(self, vrs: list[int]) -> list[float]:
        try:
            return self._last_reader() if vrs == self._last_read else self._read("Real", vrs)
        except BaseException as error:
            escape(self, error)
            raise

    @guard_method
    def get_integer(self, vrs: list[int]) -> list[int]:
        return self._read("Integer", vrs)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        try:
            reader = self._readers.get(("Boolean", *vrs))
            return self._get("Boolean", vrs) if reader is None else reader()
        except BaseException as error:
            escape(self, error)
            raise

    @guard_method
    def get_string(self, vrs: list[int]) -> list[str]:
        if vrs == [REFERENCE]:
            return [str(ctypes.addressof(self._core) if self.native else 0)]
        return self._read("String", vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        try:
            writer = self._last_writer if vrs == self._last_written else self._writers.get(("Real", *vrs))
            if writer is None or len(values) != len(vrs) or not isfinite(sum(values)):
                self._set("Real", vrs, values)
                return
            limited, events, every = writer
            for _, place, first, last in limited:
                if place.tolist() != values[first:last]:
                    self._set("Real", vrs, values)
                    return
            for _, place, first, last in events:
                if place.tolist() != values[first:last]:
                    self._on_change(True)
            for store, _, first, last in every:
                store(*values[first:last])
        except BaseException as error:
            escape(self, error)
            raise

    @guard_method
    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._set_unless_same("Integer", vrs, values)

    @guard_method
    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._set_unless_same("Boolean", vrs, values)

    @guard_method
    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self._set_unless_same("String", vrs, values)

    # --- Behind them --------------------------------------------------------------------

    def _forget_lists(self) -> None:
        """To be called when the phase changes: what may be read or set without further checks has changed."""
        self._readers: dict[Key, Reader] = {}
        self._writers: dict[Key, Writer] = {}  # Real
        self._comparers: dict[Key, Reader] = {}  # other types: what may be set, and its present values
        # Most hosts use one list all the time, and to compare lists is quicker than to hash a tuple.
        self._last_read: list[int] | None = None
        self._last_reader: Reader = list
        self._last_written: list[int] | None = None
        self._last_writer: Writer = ([], [], [])

    def _read(self, kind: str, references: list[int]) -> list[Any]:
        reader = self._readers.get((kind, *references))
        return self._get(kind, references) if reader is None else reader()

    def _set_unless_same(self, kind: str, references: list[int], values: list[Any]) -> None:
        comparer = self._comparers.get((kind, *references))
        if comparer is None or comparer() != values:
            self._set(kind, references, values)

    def _get(self, kind: str, references: list[int]) -> list[Any]:
        reader = self._buffer.reader(kind, references)
        if self._stale and any(self.layout.by_reference[vr].causality == "output" for vr in references):
            self._configure()
        if self._phase >= LifePhase.STEPPING:
            _remember(self._readers, (kind, *references), reader)
            if kind == "Real":
                self._last_read, self._last_reader = list(references), reader
        return reader()

    def _set(self, kind: str, references: list[int], values: Sequence[Any]) -> None:
        """Check all, then store all; notes what a change means for the model."""
        if len(values) != len(references):
            raise Refused(f"{len(references)} value references, but {len(values)} values")
        ports = self._buffer.ports(kind, references)
        checked = []
        for port, value in zip(ports, values, strict=True):
            if port.causality == "output":
                raise Refused(f"{port.name} is an output and cannot be set")
            if port.causality == "parameter" and self._phase >= LifePhase.STEPPING:
                raise Refused(f"{port.name} is a fixed parameter: set it before initialisation ends, or after a reset")
            if self._phase == LifePhase.TERMINATED:
                raise Refused(f"{port.name} cannot be set: the simulation is terminated")
            try:
                checked.append(port.checked(value))
            except ValueError as error:
                raise Refused(str(error)) from None
        for reference, port, new in zip(references, ports, checked, strict=True):
            if self._buffer.raw(reference) != new:
                self._on_change(port.event)
            self._buffer.store(reference, new)  # -0.0, too, in place of 0.0
        if self._phase == LifePhase.STEPPING and references:
            if kind == "Real":
                self._remember_writer(references)
            else:
                _remember(self._comparers, (kind, *references), self._buffer.reader(kind, references))

    def _remember_writer(self, references: list[int]) -> None:
        writer: Writer = ([], [], [])
        for start, first, last in find_runs(references, self._treatment):
            place = self._buffer.data[start : start + last - first]
            write = self._buffer.writer(start, last - first), place, first, last
            for group in {self._treatment(start), 2}:
                writer[group].append(write)
        _remember(self._writers, ("Real", *references), writer)
        self._last_written, self._last_writer = list(references), writer

    def _treatment(self, reference: int) -> int:
        """What a new value of this variable needs: 0 a check, 1 an event, 2 neither.  An index of Writer."""
        port = self.layout.by_reference[reference]
        if port.min is not None or port.max is not None:
            return 0
        return 1 if port.event else 2

    @abstractmethod
    def _configure(self) -> None:
        """Build the model and the outputs from parameters and inputs."""

    @abstractmethod
    def _on_change(self, event: bool) -> None:
        """After a value was set; ``event``: one that makes an event."""


def _remember(lists: dict[Key, T], key: Key, value: T) -> None:
    if len(lists) >= _MOST_LISTS:
        lists.clear()
    lists[key] = value
