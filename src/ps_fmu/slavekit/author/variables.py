"""FMI variables of a slave: declared once as :class:`Port`, turned into pythonfmu's with all attributes."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal
from xml.etree.ElementTree import Element

from pythonfmu.enums import Fmi2Causality, Fmi2Initial, Fmi2Variability
from pythonfmu.variables import Boolean, Integer, Real, ScalarVariable, String

from .units import DISPLAY_UNITS, find_exponents

Causality = Literal["input", "output", "parameter", "local"]
Type = Literal["Real", "Boolean", "Integer", "String"]
Value = float | bool | int | str

_NAME = re.compile(r"[A-Za-z_]\w*(\.[A-Za-z_]\w*)*", re.ASCII)
_LOCAL = re.compile(r"x\[\d+\]|der\(x\[\d+\]\)", re.ASCII)  # of the base class
_INT32 = 2**31


@dataclass(frozen=True)
class Port:
    """One FMI variable.

    Parameters
    ----------
    name: structured name without brackets, for example ``base_force.x`` or ``fine_force_1``.
    causality: ``"input"``, ``"output"`` or ``"parameter"`` (parameters are fixed: set before or in
        initialisation mode).  ``"local"`` is for the base class.
    unit: name of a coherent SI unit of :mod:`.units`; only for Real.
    description: one line that names the frame.
    type: FMI type.
    start: start value of inputs and parameters (outputs have none: they are calculated).
    min, max: smallest and largest value; enforced on inputs and parameters.
    nominal: typical magnitude, for tools that scale values; only for Real.
    display_unit: one of ``units.DISPLAY_UNITS[unit]``.
    event: True: a new value of this input makes an event due, see :meth:`.model.Model.event`.  None: True of inputs
        that are not Real, else False.  False: the map reads it, if it is a Real, or an element.
    depends_on: inputs that this output depends on at the same communication point; normally none, since outputs are
        latched at the end of doStep.
    initially_depends_on: inputs and parameters that this output depends on in initialisation mode; None: all of them.
    """

    name: str
    causality: Causality
    unit: str = "1"
    description: str = ""
    type: Type = "Real"
    start: Value = 0.0
    min: float | None = None
    max: float | None = None
    nominal: float | None = None
    display_unit: str | None = None
    event: bool | None = None
    depends_on: tuple[str, ...] = ()
    initially_depends_on: tuple[str, ...] | None = None

    def __post_init__(self) -> None:
        if not (_LOCAL if self.causality == "local" else _NAME).fullmatch(self.name):
            raise ValueError(
                f"port {self.name!r}: expected identifiers joined by dots, such as 'base_force.x'"
            )
        if self.causality not in ("input", "output", "parameter", "local"):
            raise self._make_error(f"causality: expected input, output, parameter or local, got {self.causality!r}")
        if self.causality != "output" and (self.depends_on or self.initially_depends_on is not None):
            raise self._make_error("only outputs have dependencies")
        if self.causality != "input" and self.event:
            raise self._make_error("only inputs can be events")
        if self.type == "String" and self.causality == "output":
            raise self._make_error("String outputs are not supported")
        self._check_unit()
        if self.causality != "output":
            object.__setattr__(self, "start", self.checked(self._read_start()))
        if self.event is None:
            object.__setattr__(self, "event", self.causality == "input" and self.type != "Real")

    def _make_error(self, problem: str) -> ValueError:
        return ValueError(f"port {self.name}: {problem}")

    def _check_unit(self) -> None:
        if self.type == "Real":
            try:
                find_exponents(self.unit)
            except ValueError as error:
                raise self._make_error(str(error)) from None
        elif self.unit != "1" or self.nominal is not None:
            raise self._make_error(f"expected neither unit nor nominal value for a {self.type}")
        known = DISPLAY_UNITS.get(self.unit, {})
        if self.display_unit is not None and self.display_unit not in known:
            choices = ", ".join(known) or "(there are none)"
            raise self._make_error(f"display unit of {self.unit!r}: expected {choices}, got {self.display_unit!r}")
        for attribute in ("min", "max", "nominal"):
            value = getattr(self, attribute)
            if value is not None and (self.type in ("Boolean", "String") or not math.isfinite(value)):
                raise self._make_error(f"{attribute} = {value!r} is not possible for a {self.type}")

    def _read_start(self) -> Value:
        """The start value, where the default 0.0 stands for the type's own zero."""
        if self.type == "String" and self.start == 0.0:
            return ""
        if self.type == "Boolean" and self.start in (0.0, 1.0):
            return bool(self.start)
        if self.type == "Integer" and isinstance(self.start, float) and self.start.is_integer():
            return int(self.start)
        return self.start

    def checked(self, value: Any) -> Value:
        """Convert ``value`` to the type of this port.

        Raises ValueError with port, value and allowed values.
        """
        if self.type == "String":
            if not isinstance(value, str) or "\0" in value:
                raise self._make_refusal(value, "text without NUL characters")
            return value
        if self.type == "Boolean":
            if value not in (False, True):
                raise self._make_refusal(value, "true or false")
            return bool(value)
        if isinstance(value, str) or (isinstance(value, bool) and self.type == "Real"):
            raise self._make_refusal(value, "a number")
        number = float(value)
        if not math.isfinite(number):
            raise self._make_refusal(value, "a finite number")
        if self.type == "Integer" and not (number.is_integer() and -_INT32 <= number < _INT32):
            raise self._make_refusal(value, "a whole number of 32 bits")
        low = -math.inf if self.min is None else self.min
        high = math.inf if self.max is None else self.max
        if not low <= number <= high:
            raise self._make_refusal(value, _describe_range(low, high))
        return int(number) if self.type == "Integer" else number

    def _make_refusal(self, value: Any, allowed: str) -> ValueError:
        unit = "" if self.unit == "1" else f" {self.unit}"
        return ValueError(f"{self.causality} {self.name} = {value!r}: expected {allowed}{unit}")


def _describe_range(low: float, high: float) -> str:
    if high == math.inf:
        return f"at least {low:g}"
    return f"at most {high:g}" if low == -math.inf else f"a value from {low:g} to {high:g}"


def vector(
    name: str, suffixes: Iterable[str], unit: str, description: str, **attributes: Any
) -> tuple[Port, ...]:
    """Ports ``name.suffix``: ``vector("base_force", "xyz", "N", "Force in B", causality="input")``.

    Further arguments are attributes of :class:`Port`; a list or tuple for start, min, max or nominal contains an entry
    per suffix.
    """
    return _make_ports([(f"{name}.{suffix}", suffix) for suffix in suffixes], unit, description, attributes)


def numbered(name: str, n: int, unit: str, description: str, **attributes: Any) -> tuple[Port, ...]:
    """Ports ``name_1`` to ``name_n``; further attributes as for :func:`vector`."""
    return _make_ports([(f"{name}_{i}", str(i)) for i in range(1, n + 1)], unit, description, attributes)


def _make_ports(
    names: Sequence[tuple[str, str]], unit: str, description: str, attributes: dict[str, Any]
) -> tuple[Port, ...]:
    ports = []
    for i, (name, suffix) in enumerate(names):
        own = dict(attributes)
        for key in ("start", "min", "max", "nominal"):
            if isinstance(own.get(key), (list, tuple)):
                if len(own[key]) != len(names):
                    raise ValueError(
                        f"port {name}: {key}: expected {len(names)} values, got {len(own[key])}"
                    )
                own[key] = own[key][i]
        ports.append(Port(name, unit=unit, description=f"{description}, {suffix}", **own))
    return tuple(ports)


_PYTHONFMU: dict[str, type[ScalarVariable]] = {
    "Real": Real, "Boolean": Boolean, "Integer": Integer, "String": String,
}  # fmt: skip


def make_fmi_variable(port: Port, reference: int) -> ScalarVariable:
    """pythonfmu's variable for a port, with all its attributes in the XML.

    What pythonfmu leaves to chance is explicit: variability always; ``initial`` wherever the standard allows
    it (not on inputs); numbers with all digits of a double.
    """
    continuous = port.type == "Real" and port.causality != "parameter"
    variability = Fmi2Variability.continuous if continuous else Fmi2Variability.discrete
    if port.causality == "parameter":
        variability = Fmi2Variability.fixed
    calculated = Fmi2Initial.calculated
    initial = {"parameter": Fmi2Initial.exact, "output": calculated, "local": calculated, "input": None}[port.causality]

    variable = _PYTHONFMU[port.type](
        port.name,
        causality=Fmi2Causality[port.causality],
        variability=variability,
        initial=initial,
        description=port.description or None,
    )
    variable.value_reference = reference
    plain = variable.to_xml

    def to_xml() -> Element:
        element: Element = plain()
        element[0].attrib.clear()
        element[0].attrib.update(_type_attributes(port))
        return element

    variable.to_xml = to_xml
    return variable


def _type_attributes(port: Port) -> dict[str, str]:
    """Attributes of the element Real, Integer, Boolean or String."""
    attributes: dict[str, str] = {}
    if port.type == "Real":
        attributes |= {"unit": port.unit} if port.causality != "local" else {}
    if port.display_unit is not None:
        attributes["displayUnit"] = port.display_unit
    for attribute in ("min", "max", "nominal"):
        value = getattr(port, attribute)
        if value is not None:
            attributes[attribute] = repr(float(value)) if port.type == "Real" else str(int(value))
    if port.causality in ("input", "parameter"):
        attributes["start"] = str(port.start).lower() if port.type == "Boolean" else str(port.start)
    return attributes
