"""Reading and writing the variables of a slave: by name for models, by value reference for hosts."""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from .buffer import Array, Buffer, BufferLayout
from .core import LINEAR_REFERENCE, REFERENCE, make_core
from .guard import ModelError, Refused
from .instructions import Finder, Places
from .model import Model
from .state import LifePhase
from .variables import Value


class Values(Model):
    """Typed access to one buffer.  While stepping, a launcher does most of it without Python."""

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
        self.a, self.memory = data[layout.a], data[layout.memory]
        self._phase = LifePhase.INSTANTIATED
        self._stale = True  # something was set since the last configure()

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
        return self._get("Real", vrs)

    def get_integer(self, vrs: list[int]) -> list[int]:
        return self._get("Integer", vrs)

    def get_boolean(self, vrs: list[int]) -> list[bool]:
        return self._get("Boolean", vrs)

    def get_string(self, vrs: list[int]) -> list[str]:
        if vrs == [REFERENCE]:
            return [str(ctypes.addressof(self._core) if self.native else 0)]
        if vrs == [LINEAR_REFERENCE]:
            try:
                self._find_rates()
            except ModelError as error:
                return [f"{self.instance_name}: no directional derivatives: {error}"]
            return [""]
        return self._get("String", vrs)

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        self._set("Real", vrs, values)

    def set_integer(self, vrs: list[int], values: list[int]) -> None:
        self._set("Integer", vrs, values)

    def set_boolean(self, vrs: list[int], values: list[bool]) -> None:
        self._set("Boolean", vrs, values)

    def set_string(self, vrs: list[int], values: list[str]) -> None:
        self._set("String", vrs, values)

    # --- Behind them --------------------------------------------------------------------

    def _get(self, kind: str, references: list[int]) -> list[Any]:
        ports = self._buffer.ports(kind, references)
        if self._stale and any(port.causality in ("output", "local") for port in ports):
            self._configure()
        first = self.layout.first_rate
        if self.layout.rates and any(reference >= first for reference in references):
            try:
                rates = self._find_rates()
            except (ModelError, Refused):  # not linear, as by a delay, or not initialised: hosts that read all go on
                rates = np.full(self.n_states, np.nan)
            read = self._buffer.typed
            return [float(rates[vr - first]) if vr >= first else read(vr) for vr in references]
        return [self._buffer.typed(reference) for reference in references]

    def _find_rates(self) -> Array:
        """Rates of the states now; the linear model is in the core."""
        if not self.provides_derivatives:
            raise Refused("directional derivatives: this FMU does not provide them")
        if self._phase == LifePhase.INSTANTIATED:
            raise Refused("directional derivatives are not possible before initialisation mode")
        if self._stale:
            self._configure()
        matrices, rates = self.linearise()
        n, ny, nu = self.n_states, self.y.size, self.u.size
        shapes = (n, n), (n, nu), (ny, n), (ny, nu)
        if tuple(np.shape(matrix) for matrix in matrices) != shapes or np.shape(rates) != (n,):
            raise ValueError(f"{type(self).__name__}.linearise: expected matrices {shapes} and rates {(n,)}")
        self._core.use_linear(matrices, type(self).linearise is Model.linearise)
        return np.asarray(rates)

    def _set(self, kind: str, references: list[int], values: Sequence[Any]) -> None:
        """Check all, then store all; notes what a change means for the model."""
        if len(values) != len(references):
            raise Refused(f"{len(references)} value references, but {len(values)} values")
        ports = self._buffer.ports(kind, references)
        checked = []
        for port, value in zip(ports, values, strict=True):
            if port.causality in ("output", "local"):
                kind = "an output" if port.causality == "output" else "a local variable"
                raise Refused(f"{port.name} is {kind} and cannot be set")
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
                self._on_change(bool(port.event))
            self._buffer.store(reference, new)  # -0.0, too, in place of 0.0

    @abstractmethod
    def _configure(self) -> None:
        """Build the model and the outputs from parameters and inputs."""

    @abstractmethod
    def _on_change(self, event: bool) -> None:
        """After a value was set; ``event``: one that makes an event."""
