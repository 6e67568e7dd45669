"""Model descriptions of FMUs, read by FMPy after the file has been checked; conversion of values to FMI types."""

from __future__ import annotations

import logging
import math
from collections.abc import Mapping
from contextlib import suppress
from functools import lru_cache
from pathlib import Path

from fmpy import read_model_description
from fmpy.model_description import ModelDescription, ModelVariable

from ..files.archive import check_archive, read_member
from ..files.plain import compute_file_digest
from ..files.xmlfile import MAXIMUM_BYTES, Element, parse_xml
from ..terminal import escape_controls
from .errors import SystemFileError, UsageError
from .structure import PortName, System, Value, suggest_names
from .values import EXPECTED, fits_int32, parse_real, parse_value

log = logging.getLogger("ps_fmu.cosim")

DISCRETE_TYPES = ("Integer", "Boolean", "Enumeration")
"""Types that FMI passes as C int."""


def read_description(path: Path, lenient: bool = False) -> ModelDescription:
    """Model description of an FMU for co-simulation (FMI 2.0).

    ``lenient``: one that can be read although it breaks rules of FMI is taken, with a warning in the log.

    Raises :class:`SystemFileError`: not a safe archive, no or a malformed ``modelDescription.xml``, another
    FMI version, no co-simulation, a variable name that occurs twice.  It is for reading only: as long as the file has
    the same content, it is the same object.
    """
    return _read_description(path, compute_file_digest(path), lenient)


@lru_cache(maxsize=64)  # 13 ms for each of ours
def _read_description(path: Path, _digest: str, lenient: bool) -> ModelDescription:
    check_archive(path)
    root = parse_xml(read_member(path, "modelDescription.xml", MAXIMUM_BYTES), path / "modelDescription.xml")
    if root.attributes.get("fmiVersion") != "2.0":
        version = root.attributes.get("fmiVersion")
        raise SystemFileError(path, f"expected an FMU of FMI 2.0, got fmiVersion {version!r}: export it as that")
    description = _parse(path, lenient)
    if description.coSimulation is None:
        raise SystemFileError(path, "the FMU is not for co-simulation: export it as a co-simulation FMU")
    identifier = description.coSimulation.modelIdentifier
    if identifier is None:
        raise SystemFileError(path, "its element CoSimulation states no modelIdentifier, the name of the library")
    if not (identifier.isascii() and identifier.isidentifier()):
        raise SystemFileError(path, f"modelIdentifier {identifier!r} is not a C identifier")
    for declared in description.typeDefinitions:
        for item in declared.items or ():
            if not isinstance(parse_value("Integer", item.value or ""), int):
                text = f"item {item.name!r} of the enumeration {declared.name!r} has the value {item.value!r}"
                raise SystemFileError(path, f"{text}: expected {EXPECTED['Integer']}")
    for variable in description.modelVariables:
        if not {"\n", "\r"}.isdisjoint(variable.name):  # such a name could forge lines of messages
            raise SystemFileError(path, f"the name of the variable {variable.name!r} contains a line break: rename it")
    return description


def _parse(path: Path, lenient: bool) -> ModelDescription:
    try:
        return read_model_description(path)
    # FMPy raises plain Exception, and whatever a malformed file makes it trip over.
    except Exception as error:
        if lenient:
            with suppress(Exception):
                description = read_model_description(path, validate=False)
                why = escape_controls(str(error))
                log.warning("%s: breaks rules of FMI and is run all the same: %s", path.name, why)
                return description
        raise SystemFileError(path, f"modelDescription.xml is not valid: {error}") from error


def read_descriptions(system: System, lenient: bool = False) -> dict[str, ModelDescription]:
    """Model descriptions of a system's FMUs by component; each file is read once.

    ``lenient``: see :func:`read_description`.  Raises :class:`SystemFileError`.
    """
    with system.name_members():
        sources = dict.fromkeys(component.source for component in system.components)
        read = {source: read_description(source, lenient) for source in sources}
    return {component.name: read[component.source] for component in system.components}


def index_variables(description: ModelDescription) -> dict[str, ModelVariable]:
    """Variables by name."""
    return {variable.name: variable for variable in description.modelVariables}


def find_variable(description: ModelDescription, name: str) -> ModelVariable:
    """A variable by name.  Raises :class:`UsageError` with the closest names."""
    variables = index_variables(description)
    if name not in variables:
        hint = suggest_names(name, variables)
        raise UsageError(f"there is no variable {name!r} in the FMU {description.modelName}{hint}")
    return variables[name]


def read_start(variable: ModelVariable) -> Value:
    """The start value that the model description states as text, as its FMI type."""
    text = str(variable.start)
    if variable.type == "Boolean":
        return text.lower() in ("true", "1")
    if variable.type == "Real":
        return float(text)
    return text if variable.type == "String" else int(text)


def read_tolerance(description: ModelDescription) -> float | None:
    """The relative tolerance that the default experiment of an FMU states; None for what is no number above 0."""
    own = description.defaultExperiment
    tolerance = None if own is None or own.tolerance is None else parse_real(str(own.tolerance))
    return tolerance if tolerance is not None and tolerance > 0.0 else None


def get_unit(variable: ModelVariable) -> str | None:
    """Unit of a variable, its own or that of its declared type; None where the FMU states none."""
    declared = variable.declaredType.unit if variable.declaredType is not None else None
    return variable.unit or declared or None


def explain_unsettable(variable: ModelVariable, running: bool) -> str | None:
    """Why the master may not set a variable, or None if it may (FMI 2.0.4, section 2.2.7)."""
    if variable.causality == "input" or (variable.causality == "parameter" and variable.variability == "tunable"):
        return None
    if variable.causality == "parameter":
        return "is a fixed parameter: set it before initialisation" if running else None
    return f"cannot be set: expected an input or a parameter, its causality is {variable.causality}"


def convert_value(variable: ModelVariable, value: Value) -> Value:
    """``value`` as the exact FMI type of the variable; a whole number is taken for a Real.

    Raises :class:`UsageError`, without the name: another type, not finite, outside the declared bounds.
    """
    kind = variable.type
    result: Value
    if kind == "Real" and isinstance(value, (int, float)) and not isinstance(value, bool):
        result = float(value)
        if not math.isfinite(result):
            raise UsageError(f"expected a finite number, got {value!r}")
    elif kind in ("Integer", "Enumeration") and isinstance(value, int) and not isinstance(value, bool):
        if not fits_int32(value):
            raise UsageError(f"{value} does not fit a 32-bit integer")
        result = value
    elif kind == "Boolean" and isinstance(value, bool):
        return value
    elif kind == "String" and isinstance(value, str):
        if "\0" in value:
            raise UsageError("the text contains a NUL character")
        return value
    else:
        raise UsageError(f"expected a value of type {kind}, got {value!r} ({type(value).__name__})")
    low, high = (_bound(text) for text in (variable.min, variable.max))
    if (low is not None and result < low) or (high is not None and result > high):
        raise UsageError(f"{value!r} is outside [{variable.min or '-inf'}, {variable.max or 'inf'}]")
    return result


def check_value(descriptions: Mapping[str, ModelDescription], port: PortName, value: Value, running: bool) -> Value:
    """What :func:`convert_value` makes of the ``value`` of a component's variable, if the master may set that now.

    Raises :class:`UsageError` with the variable's name.
    """
    variable = find_variable(descriptions[port.component], port.variable)
    if reason := explain_unsettable(variable, running):
        raise UsageError(f"{port} {reason}")
    try:
        return convert_value(variable, value)
    except UsageError as error:
        raise UsageError(f"{port}: {error}") from None


def _bound(text: str | None) -> float | None:
    try:
        return None if text is None else float(text)
    except ValueError:
        return None


_PLACE = "terminalsAndIcons/terminalsAndIcons.xml"


def read_terminal_variables(fmu: Path) -> frozenset[str] | None:
    """Names of the variables in the terminals of an FMU whose archive has been checked; None: it has no terminals.

    A file that cannot be read counts as none: nothing of a simulation depends on it.
    """
    try:
        root = parse_xml(read_member(fmu, _PLACE, MAXIMUM_BYTES), fmu / _PLACE)
    except SystemFileError:
        return None
    found = frozenset(_list_variables(root))
    return found or None


def _list_variables(element: Element) -> list[str]:
    own = [element.attributes.get("variableName", "")] if element.tag == "TerminalMemberVariable" else []
    return [name for name in own if name] + [name for child in element.children for name in _list_variables(child)]
