"""The numbers and texts of one slave: one buffer of doubles, value reference = place in the buffer, and a list."""

from __future__ import annotations

import hashlib
import math
import re
from collections.abc import Iterable, Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from .guard import Refused
from .variables import Port, Value

Array = NDArray[np.float64]

ALIGNMENT = 64  # bytes: a cache line, and the widest vector register
_PYTHON_TYPES = {"Real": float, "Integer": int, "Boolean": bool, "String": str}
_ONE_LEVEL = re.compile(r"\.[^.]+|_\d+")
_READ = {"Real": 1, "Integer": 2, "Boolean": 4}
_SET, _EVENT = 8, 16
_LARGEST = float(np.finfo(np.float64).max)


class BufferLayout:
    """The buffer ``[y outputs|x states|u inputs|a auxiliary|other inputs|parameters|memory]``.

    ``y`` and ``x`` are adjacent, and so are ``x``, ``u`` and ``a``: a step is ``[y; x] <- M @ [x; u; a]``.
    Booleans and Integers are kept as doubles.  Strings live in a list outside; their references follow the
    buffer.

    Raises ValueError, naming the port, if the ports contradict each other.
    """

    def __init__(
        self,
        model: str,
        version: str,
        ports: Sequence[Port],
        n_states: int,
        n_auxiliary: int,
        n_memory: int,
        n_rates: int = 0,
    ) -> None:
        self.model = model
        self.ports = tuple(ports)
        self.strings = [port for port in self.ports if port.type == "String"]
        numeric = [port for port in self.ports if port.type != "String"]
        outputs = [port for port in numeric if port.causality == "output"]
        every_input = [port for port in numeric if port.causality == "input"]
        inputs = [port for port in every_input if port.type == "Real" and not port.event]
        events = [port for port in every_input if port not in inputs]
        parameters = [port for port in numeric if port.causality == "parameter"]

        sizes = [len(outputs), n_states, len(inputs), n_auxiliary, len(events), len(parameters), n_memory]
        ends = np.cumsum([0, *sizes]).tolist()
        regions = [slice(first, last) for first, last in pairwise(ends)]
        self.y, self.x, self.u, self.a, self.events, self.parameters, self.memory = regions
        self.source = slice(self.x.start, self.a.stop)
        """The operand ``[x; u; a]`` of a step."""
        self.target = slice(self.y.start, self.x.stop)
        """Its result ``[y; x]``."""
        self.size: int = ends[-1]

        self.by_reference: dict[int, Port] = {}
        for region, group in zip(regions, (outputs, (), inputs, (), events, parameters, ()), strict=True):
            self.by_reference |= dict(enumerate(group, region.start))
        self.by_reference |= dict(enumerate(self.strings, self.size))
        # Only for directional derivatives: states, and behind everything their rates, which lie in no buffer.
        self.first_rate: int = self.size + len(self.strings)
        self.rates = [Port(f"der(x[{i}])", "local", description=f"Rate of state {i}") for i in range(1, n_rates + 1)]
        states = [Port(f"x[{i}]", "local", description=f"State {i}") for i in range(1, n_rates + 1)]
        self.local = (*states, *self.rates)
        self.by_reference |= dict(enumerate(states, self.x.start)) | dict(enumerate(self.rates, self.first_rate))
        self.reference = {port.name: reference for reference, port in self.by_reference.items()}
        self._check()
        self._list_access()
        self.identity = self._identity(version, sizes)
        """SHA-256 of model, version, variables and sizes: who may exchange FMU states."""

    def _check(self) -> None:
        declared = [port.name for port in self.ports]
        if len(self.reference) < len(declared):
            twice = sorted({name for name in declared if declared.count(name) > 1})
            raise ValueError(f"{self.model}: declared twice: {', '.join(twice)}")
        inputs = {port.name for port in self.ports if port.causality == "input"}
        knowns = inputs | {port.name for port in self.ports if port.causality == "parameter"}
        for port in self.ports:
            for allowed, listed, what in (
                (inputs, port.depends_on, "inputs"),
                (knowns, port.initially_depends_on or (), "inputs and parameters"),
            ):
                unknown = sorted(set(listed) - allowed)
                if unknown:
                    names = ", ".join(unknown)
                    raise ValueError(f"{self.model}: {port.name} depends on {names}, not among the {what}")

    def _list_access(self) -> None:
        """What the launcher may do with each place while stepping, see ``native/kernel/core.h``."""
        self.kinds = np.zeros(self.size, dtype=np.uint8)
        self.low, self.high = np.full(self.size, -_LARGEST), np.full(self.size, _LARGEST)
        for reference, port in self.by_reference.items():
            if reference < self.size:
                settable = _SET if port.causality == "input" else 0
                self.kinds[reference] = _READ[port.type] | settable | (_EVENT if port.event else 0)
                self.low[reference] = -_LARGEST if port.min is None else port.min
                self.high[reference] = _LARGEST if port.max is None else port.max

    def _identity(self, version: str, sizes: Iterable[int]) -> bytes:
        variables = (f"{port.name} {port.causality} {port.type}" for port in self.by_reference.values())
        text = "\n".join(map(str, (self.model, version, *sizes, *variables)))
        return hashlib.sha256(text.encode()).digest()

    def group(self, names: str | Sequence[str]) -> list[int]:
        """References of several numeric variables.

        A text stands for its components, one level down: ``"base_force"`` for ``base_force.x``, ``.y``,
        ``.z``; ``"coarse_command"`` for ``coarse_command_1`` to ``_3``.  Otherwise a sequence of full names.

        Raises KeyError if there is no such variable.
        """
        if isinstance(names, str):
            found = [
                name
                for name in self.reference
                if name == names or (name.startswith(names) and _ONE_LEVEL.fullmatch(name, len(names)))
            ]
            if not found:
                raise KeyError(f"there is no variable {names!r}, {names}.* or {names}_1 ... in {self.model}")
        else:
            found = list(names)
        references = [self.find(name) for name in found]
        for name, reference in zip(found, references, strict=True):
            if reference >= self.size:
                raise KeyError(f"{self.model}: {name} is a String and not in the buffer")
        return references

    def describe(self, place: int) -> str:
        """What lies at a place of the buffer, for messages: a variable's name, or for example ``state 3``."""
        if place in self.by_reference:
            return self.by_reference[place].name
        regions = {"state": self.x, "auxiliary": self.a, "memory": self.memory}
        return next(f"{name} {place - r.start}" for name, r in regions.items() if r.start <= place < r.stop)

    def find(self, name: str) -> int:
        """The reference of one variable; KeyError if there is none of that name."""
        try:
            return self.reference[name]
        except KeyError:
            raise KeyError(f"there is no variable {name!r} in {self.model}") from None


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
            if port.causality in ("input", "parameter") and reference < layout.size:
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
