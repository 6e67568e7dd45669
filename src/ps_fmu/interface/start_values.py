"""Start values of FMUs by ``component.variable``.

Those of the paper's four FMUs follow from a parameter set, and back (:func:`start_values`); those of the components of
any system from one description of the instrument (:func:`make_start_values`).
"""

from __future__ import annotations

import json
import re
import reprlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from fmpy.model_description import ModelDescription, ModelVariable

from ..control.commander import Commander, is_geometric
from ..control.isolator import Isolator
from ..cosim import System, UsageError, Value
from ..cosim.description import convert_value, get_unit, index_variables, read_start
from ..cosim.structure import Parameter, suggest_names
from ..disturbance import default_settings
from ..mechanism.instrument import Instrument
from ..mechanism.linear_model import Plant
from ..mechanism.parameters import Parameters, load
from ..mechanism.quantities import ParameterError, list_entries, replace_values, take_values
from ..slavekit.author.units import parse_unit
from .agreement import APART, REFERENCE

Physics = Callable[[Parameters], Any]
"""Makes what the parameters of an FMU are from a parameter set, see :mod:`.instrument_file`."""
_DEEPEST = 10  # tables in tables below [start]
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(\S.*)")
_BOTH = {"speed": ("initial_speed", "final_speed")}  # of a [[wheel]]

#: Start values of the isolator that are not of a parameter set.
IDEAL: dict[str, Value] = {f"isolator.{name}": 0.0 for name in ("delay", "sample_time", "force_limit")}


def start_values(p: Parameters) -> dict[str, Value]:
    """Start values of plant, isolator, commander and disturbance source that a parameter set states.

    Modes that the set does not have are zero.  Raises ParameterError as :meth:`.Parameters.fill_places`.
    """
    components = {
        "plant": list_entries(Plant.from_parameters(p)),
        "isolator": list_entries(Isolator.from_parameters(p)),
        "commander": list_entries(Commander.from_parameters(p), keep=is_geometric),
        "disturbance": list_entries(default_settings(p)),
    }
    return {f"{component}.{entry.name}": entry.value for component, found in components.items() for entry in found}


def differences(p: Parameters) -> dict[str, Value]:
    """The start values that are not those of paper.toml."""
    paper = start_values(load())
    return {name: value for name, value in start_values(p).items() if value != paper[name]}


def build_plant_and_isolator(system: System) -> tuple[Plant, Isolator]:
    """Plant and isolator from the start values of a system; values that it does not give are those of paper.toml.

    Raises
    ------
    ParameterError: an impossible value.
    """
    p = load()
    return (
        take_values(Plant.from_parameters(p), _given(system, "plant")),
        take_values(Isolator.from_parameters(p), _given(system, "isolator")),
    )


def list_departures(given: Mapping[str, Value]) -> list[str]:
    """Names of the start values that make another system than that of paper.toml with an ideal isolator."""
    paper = start_values(load()) | IDEAL
    return [name for name, value in given.items() if paper.get(name, value) != value]


def _given(system: System, component: str) -> dict[str, Value]:
    return {name: entry.value for name, entry in system.component(component).parameters.items()}


def make_start_values(
    instrument: Instrument,
    system: System,
    descriptions: Mapping[str, ModelDescription],
    physics: Mapping[str, Physics],
    *,
    everything: bool = False,
) -> dict[str, Parameter]:
    """Start values that make the FMUs of a system those of an instrument, by ``component.variable``.

    Values that the FMUs start with anyway are left out, unless the instrument's ``[start]`` gives them, or another FMU
    gets a value of this name.  What an FMU is told apart from the plant carries the note :data:`.agreement.APART`.

    Parameters
    ----------
    instrument: what the file of the instrument states.
    system, descriptions: the system, and the model description of each of its components.
    physics: by the name of an FMU, the function that makes its parameters from a set, see :mod:`.instrument_file`.
    everything: also the values that the FMUs start with.

    Raises
    ------
    ParameterError: a mode too many, a value that is impossible, a name that does not exist; the text names it.
    """
    names = [component.name for component in system.components]
    for name in instrument.start:
        if name not in names:
            hint = suggest_names(name, names) or f"; the system has {', '.join(names)}"
            raise ParameterError(f"start.{reprlib.repr(name)[1:-1]}", f"no such component{hint}")
    p = instrument.parameters.fill_places()
    values: dict[str, dict[str, Value]] = {}
    given: set[str] = set()
    lists = {kind: tables for kind, tables in instrument.lists.items() if tables}
    for name in names:
        variables = list_settable(descriptions[name])
        make = physics.get(descriptions[name].modelName)
        own: dict[str, Value] = {}
        for kind in [kind for kind in lists if f"more_{kind}s" in variables]:
            own |= _place_list(kind, lists.pop(kind), variables, None if make is None else make(p))
        own |= dict(_flatten(instrument.start.get(name, {}), variables, f"start.{name}"))
        values[name] = {**({} if make is None else _list_values(make, p, own, variables, name)), **own}
        given |= {f"{name}.{variable}" for variable in own}
    for kind in lists:
        raise ParameterError(f"[[{kind}]]", f"no FMU of the system has {kind}s: it has no disturbance source")
    return _select(values, descriptions, given, everything)


def list_settable(description: ModelDescription) -> dict[str, ModelVariable]:
    """The parameters and inputs of an FMU by name."""
    variables = index_variables(description)
    return {name: found for name, found in variables.items() if found.causality in ("parameter", "input")}


def _place_list(
    kind: str, tables: Sequence[Any], variables: Mapping[str, ModelVariable], settings: Any
) -> dict[str, Value]:
    """Start values of ``wheel_1``, ``wheel_2`` ... for tables ``[[wheel]]``; ``more_wheels`` has those beyond them.

    ``settings``: those of the FMU with this parameter set, where a further wheel is if its table does not say that.
    """
    found: dict[str, Value] = {}
    further = []
    for number, table in enumerate(tables, 1):
        full = {name: value for name, value in table.items() if name not in _BOTH}
        full |= {name: table[key] for key, both in _BOTH.items() if key in table for name in both}
        if f"{kind}_1.enabled" in variables:
            full.setdefault("enabled", True)
        place = f"{kind}_{number}"
        if f"{place}.frequency" in variables or f"{place}.enabled" in variables:
            found |= dict(_flatten(full, variables, f"[[{kind}]] {number}", place))
            continue
        first = f"{kind}_1."
        own = {entry.name: entry.value for entry in list_entries(settings) if entry.name.startswith(f"{first}position")}
        own |= dict(_flatten(full, variables, f"[[{kind}]] {number}", first[:-1]))
        further.append({name.removeprefix(first): value for name, value in own.items()})
    return found | ({f"more_{kind}s": json.dumps(further)} if further else {})


def _list_values(
    make: Physics, p: Parameters, own: Mapping[str, Value], variables: Mapping[str, ModelVariable], component: str
) -> dict[str, Value]:
    """What the physics of a component says, with the component's ``own`` values in it: they are checked together."""
    try:
        settings = make(p)
        known = {entry.name for entry in list_entries(settings)}
        settings = replace_values(settings, {name: value for name, value in own.items() if name in known})
        found = {entry.name: entry.value for entry in list_entries(settings)}
    except ParameterError as error:
        raise ParameterError(f"{component}.{error.name}", error.problem) from None
    if unknown := [name for name in found if name not in variables]:
        raise ParameterError(
            f"{component}.{unknown[0]}", "the FMU has no such parameter: build it again from its present sources"
        )
    return found


def _flatten(
    table: Any, variables: Mapping[str, ModelVariable], where: str, prefix: str = "", depth: int = 0
) -> Iterator[tuple[str, Value]]:
    """Name and value of each variable that the tables of a component give; a list gives the values of a vector."""
    if not isinstance(table, dict) or depth > _DEEPEST:
        raise ParameterError(f"{where}{prefix and '.'}{prefix}", f"expected a table, got {reprlib.repr(table)}")
    for key, value in table.items():
        name = f"{prefix}.{key}" if prefix else key
        if isinstance(value, dict):
            yield from _flatten(value, variables, where, name, depth + 1)
        elif isinstance(value, list):
            yield from _spread(name, value, variables, where)
        else:
            yield name, _convert(name, value, variables, where)


def _spread(
    name: str, values: list[Any], variables: Mapping[str, ModelVariable], where: str
) -> Iterator[tuple[str, Value]]:
    """The components of a vector, in the order of the FMU: ``name.x``, ``name.y`` or ``name_1``, ``name_2`` ..."""
    component = re.compile(re.escape(name) + r"(\.\w+|_\d+)")
    found = [variable for variable in variables if component.fullmatch(variable)]
    if not found:
        raise _unknown(name, variables, where)
    if len(found) != len(values):
        raise ParameterError(f"{where}.{name}", f"expected {len(found)} values ({', '.join(found)}), got {len(values)}")
    for variable, value in zip(found, values, strict=True):
        yield variable, _convert(variable, value, variables, where)


def _convert(name: str, value: Any, variables: Mapping[str, ModelVariable], where: str) -> Value:
    if name not in variables:
        raise _unknown(name, variables, where)
    try:
        if variables[name].type == "Real" and isinstance(value, str):
            value = _read_number(value, get_unit(variables[name]) or "1")
        return convert_value(variables[name], value)
    except (UsageError, OverflowError) as error:
        raise ParameterError(f"{where}.{name}", str(error)) from None


def _read_number(text: str, unit: str) -> float:
    """A number of a unit from a text such as ``0.3 g.cm``.  Raises UsageError."""
    found, wanted = _NUMBER.fullmatch(text.strip()), parse_unit(unit)
    own = None if found is None else parse_unit(found[2])
    if found is None or own is None or wanted is None or own.exponents != wanted.exponents or own.offset:
        raise UsageError(f"expected a number in {unit}, or a text with another unit of it, got {text!r}")
    return float(found[1]) * own.scale / wanted.scale


def _unknown(name: str, variables: Mapping[str, ModelVariable], where: str) -> ParameterError:
    shown = reprlib.repr(name)[1:-1]
    stems = {variable.rpartition(".")[0] for variable in variables} - {""}
    hint = suggest_names(name, [*variables, *stems])
    return ParameterError(f"{where}.{shown}", f"the FMU has no such parameter or input{hint}")


def _select(
    values: Mapping[str, Mapping[str, Value]],
    descriptions: Mapping[str, ModelDescription],
    given: set[str],
    everything: bool,
) -> dict[str, Parameter]:
    indexed = {name: index_variables(description) for name, description in descriptions.items()}
    wanted = {
        variable
        for name, found in values.items()
        for variable, value in found.items()
        if everything or f"{name}.{variable}" in given or value != read_start(indexed[name][variable])
    }
    truth = values.get(REFERENCE, {})
    return {
        f"{name}.{variable}": Parameter(
            value,
            get_unit(indexed[name][variable]),
            "the file of the instrument",
            frozenset({APART} if variable in truth and value != truth[variable] else ()),
        )
        for name, found in values.items()
        for variable, value in found.items()
        if variable in wanted
    }
