"""One's own instrument as a TOML file in the form of ``paper.toml``: what it gives, and what it inherits.

``base = "paper"`` (or the path of another file, from the folder of this one) at the head of a file lets it give only
what differs.  An entry that is given replaces that of the base; a list is replaced as a whole, except the legs:

- ``[[manipulator.fine_legs]]`` three times: each inherits from the leg at its place;
- ``[manipulator.fine_legs]`` once: the values are those of all three.

A leg may state its nominal ``length`` (m): it must be the distance of its joints at the nominal pose.
``manipulator.scale`` multiplies the lengths that are inherited: nominal translation, stroke, joints, centres of mass of
the legs' parts; the inertias of these by its square (their masses stay).

The bus is ``[bus]``, given as a whole, or on top of one of the base with ``base = "OSM"`` in it.  Its modes are those
of ``[[bus.modes]]``, of ``[bus.finite_elements]`` (:mod:`.finite_elements`) and of ``[[bus.appendage]]``
(:class:`.modes.Appendage`); those of the payload likewise, without appendages.  A file without ``[bus]`` has the buses
of its base.  Who gives ``payload.com_P`` without ``isolator.known_com_P`` has an isolator that knows it exactly.

``[[wheel]]`` and ``[[tone]]``, any number of each, are reaction wheels and sines of the disturbance.
``[start.COMPONENT]`` holds what no table of ``paper.toml`` speaks of: other parameters and inputs of the FMUs.  In all
of these a text that ends with ``.csv`` names a file: in the folder of this one, or else in the working directory.
"""

from __future__ import annotations

import copy
import reprlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any

import numpy as np

from .finite_elements import put_modes
from .inverse_kinematics import inverse_kinematics, pure_limits
from .kinematics import condition_number, platform_jacobian
from .modes import Appendage, join_bodies
from .parameters import PAPER, Bus, Manipulator, Parameters, build, load, make_parameters, read_table, refuse_unknown
from .quantities import Array, ParameterError, check_inertia, check_number, check_truth, freeze
from .rotations import rotation_matrix

Table = dict[str, Any]

TABLES = ("manipulator", "payload", "bus", "servo", "optics", "filters", "isolator", "noise")
LISTS = ("wheel", "tone")
KEYS = ("base", *TABLES, *LISTS, "start")
OWN_BUS = "own"
"""Name of the bus that ``[bus]`` states without a name."""
DEFAULT_BUS = "OSM"
LEGS = ("coarse_legs", "fine_legs")
FLEXIBLE = {"modes", "finite_elements"}
"""Entries of the payload that state its modes."""
ANGLES = ("roll", "pitch", "yaw")
CLOSED = 1e-4  # m, by which a leg's stated length may differ from the distance of its joints
SMALL_REACH = 0.7  # of the published mechanism's: a warning below
LARGE_CONDITION = 20.0  # a warning above
DEEPEST_BASE = 8  # files that inherit from each other, one from the next


@dataclass(frozen=True, eq=False)
class Instrument:
    """What a file states."""

    parameters: Parameters
    start: Table
    """``[start]``: by component, the values of its parameters and inputs as nested tables."""
    lists: Mapping[str, Sequence[Table]]
    """By the name of :data:`LISTS`, the tables ``[[wheel]]`` and ``[[tone]]``."""
    inherited: tuple[str, ...]
    """Entries of the base that the file leaves as they are, such as ``payload.truss_modes``; whole tables as one."""
    remarks: tuple[str, ...] = ()
    """Lines on what the file gives, such as the modes of a finite-element model."""
    warnings: tuple[str, ...] = ()
    """What is unusual, such as a small stroke."""


@dataclass(frozen=True, eq=False)
class _Notes:
    """What is found on the way to the tables of a file."""

    remarks: list[str] = field(default_factory=list)
    lengths: dict[str, float] = field(default_factory=dict)
    """Nominal lengths of legs that the file states, m, by ``coarse_legs[1]``."""


def read_instrument(path: Path, bus: str | None = None) -> Instrument:
    """Read a file in the form that this module's text states.

    Parameters
    ----------
    path: the TOML file.
    bus: name of its bus (default: that of ``[bus]``, or else ``OSM``).

    Raises
    ------
    ParameterError: an entry is missing, unknown or impossible; the text names it.
    """
    own, notes = _read(path), _Notes()
    table = _inherit(own, path, 0, notes)
    for name in TABLES:
        if not table.get(name):
            raise ParameterError(name, 'missing: with base = "paper" at its head, a file need give only what differs')
    name, entries = _select_bus(table, bus)
    inherited = tuple(_list_inherited(own, table)) if "base" in own else ()
    lists = {name: table.get(name, []) for name in LISTS}
    parameters, warnings = make_parameters(table, entries, name), list[str]()
    if "manipulator" in own:
        _check_lengths(parameters.manipulator, notes.lengths)
        lines, warnings = describe_geometry(parameters.manipulator)
        notes.remarks[:0] = lines
    return Instrument(parameters, table.get("start", {}), lists, inherited, tuple(notes.remarks), tuple(warnings))


def _read(path: Path) -> Table:
    table = read_table(path)
    refuse_unknown(table, KEYS, "")
    for key in set(table) - {"base", *LISTS}:
        _check_table(table[key], key)
    for key in LISTS:
        if not isinstance(table.get(key, []), list):
            raise ParameterError(key, f"write each as [[{key}]], got {reprlib.repr(table[key])}")
        for item in table.get(key, []):
            _check_table(item, f"[[{key}]]")
    return table | {key: _find_files(table[key], path.parent) for key in (*LISTS, "start") if key in table}


def _find_files(value: Any, folder: Path) -> Any:
    """The value, with the absolute path of each file of numbers that lies in a folder."""
    if isinstance(value, dict):
        return {key: _find_files(item, folder) for key, item in value.items()}
    if isinstance(value, list):
        return [_find_files(item, folder) for item in value]
    is_name = isinstance(value, str) and value.endswith(".csv") and value.isprintable()
    return str((folder / value).absolute()) if is_name and (folder / value).is_file() else value


def _check_table(value: Any, name: str) -> Table:
    if not isinstance(value, dict):
        raise ParameterError(name, f"expected a table, got {reprlib.repr(value)}")
    return value


def _inherit(own: Table, path: Path, depth: int, notes: _Notes) -> Table:
    """The tables of a file with all that it inherits; buses by name, each complete.

    ``notes`` are added to.
    """
    own = copy.deepcopy(own)
    named = own.pop("base", None)
    if named is None:
        base: Table = {}
    elif not isinstance(named, str) or not named:
        raise ParameterError("base", f'expected "paper" or the path of a file, got {reprlib.repr(named)}')
    elif depth == DEEPEST_BASE:
        raise ParameterError("base", f"{path.name}: more than {DEEPEST_BASE} files inherit from each other")
    else:
        source = PAPER if named == "paper" else path.parent / named
        base = _inherit(_read(source), source, depth + 1, _Notes())
    return _put_on_base(own, base, path.parent, notes)


def _put_on_base(own: Table, base: Table, folder: Path, notes: _Notes) -> Table:
    manipulator = own.get("manipulator", {})
    if "scale" in manipulator:
        if "manipulator" not in base:
            raise ParameterError("manipulator.scale", 'nothing is inherited that it could scale: give base = "paper"')
        scale = check_number(manipulator.pop("scale"), "manipulator.scale", above=0.0)
        base["manipulator"] = _scale(base["manipulator"], scale)
    _take_lengths(manipulator, notes.lengths)
    if "payload" in own:
        if own["payload"].keys() & FLEXIBLE:  # they replace all modes of the base
            own["payload"].setdefault("truss_modes", [])
        notes.remarks.extend(put_modes(own["payload"], "P", folder, "payload"))
    if "com_P" in own.get("payload", {}) and "known_com_P" not in own.get("isolator", {}):
        own.setdefault("isolator", {})["known_com_P"] = own["payload"]["com_P"]
    buses = dict(base.get("bus", {}))
    for name, entries in _name_buses(own.pop("bus", {})).items():
        where = "bus" if name == OWN_BUS else f"bus.{name}"
        entries = dict(_check_table(entries, where))
        notes.remarks.extend(put_modes(entries, "B", folder, where))
        buses[name] = _complete_bus(entries, base.get("bus", {}), where)
    merged = _merge(base, own)
    merged["bus"] = buses
    return merged


def _take_lengths(manipulator: Table, lengths: dict[str, float]) -> None:
    """Take the nominal lengths out of the legs' tables."""
    for kind in LEGS:
        legs = manipulator.get(kind)
        for number, leg in enumerate(legs if isinstance(legs, list) else [], 1):
            if isinstance(leg, dict) and "length" in leg:
                name = f"{kind}[{number}]"
                lengths[name] = check_number(leg.pop("length"), f"manipulator.{name}.length", above=0.0)


def _check_lengths(manipulator: Manipulator, lengths: dict[str, float]) -> None:
    """Raise ParameterError for a leg whose stated nominal length is not the distance of its joints."""
    for name, found in zip(_list_legs(), manipulator.geometry.nominal_lengths, strict=True):
        if abs(lengths.get(name, found) - found) > CLOSED:
            raise ParameterError(
                f"manipulator.{name}.length", f"{lengths[name]:g} m, but at the nominal pose its joints are "
                f"{found:.6g} m apart: the chain does not close; check base_joint_B, platform_joint_P (in P) and "
                "nominal_translation_B",
            )  # fmt: skip


def describe_geometry(manipulator: Manipulator) -> tuple[list[str], list[str]]:
    """Lines on lengths, reach and conditioning of a mechanism; and warnings where one of these is unusual."""
    geometry, paper = manipulator.geometry, load().manipulator.geometry
    lengths, (low, high) = geometry.nominal_lengths, 1e3 * geometry.coarse_stroke
    reach, usual = (np.degrees(pure_limits(one)) for one in (geometry, paper))
    ends = np.radians(reach.T[:, :, None] * np.eye(3)).reshape(-1, 3)
    orientations = np.vstack([np.zeros(3), ends])
    pose = inverse_kinematics(geometry, orientations)
    J_lp = platform_jacobian(geometry, pose.translation_B, rotation_matrix(orientations))
    conditions = condition_number(geometry, J_lp)
    angles = ", ".join(f"{name} {a:.1f} to {b:.1f}" for name, (a, b) in zip(ANGLES, reach, strict=True))
    lines = [
        f"legs at the nominal pose (mm): coarse {_list_mm(lengths[:3])}; fine {_list_mm(lengths[3:])}",
        f"coarse stroke {low:g} to {high:g} mm; reach of each angle alone (deg):",
        f"  {angles}",
        f"condition number {conditions[0]:.2f} at the nominal pose, up to {conditions.max():.2f} within reach",
    ]
    warnings = [
        f"the mechanism reaches {a:.1f} to {b:.1f} deg of {name}, the published one {c:.1f} to {d:.1f} deg: look at "
        "nominal_translation_B, coarse_stroke and the joints, if less is not meant"
        for name, (a, b), (c, d) in zip(ANGLES, reach, usual, strict=True)
        if min(a / c, b / d) < SMALL_REACH
    ]
    if conditions.max() > LARGE_CONDITION:
        warnings.append(
            f"the legs are close to singular: condition number {conditions.max():.1f} within reach (published "
            "mechanism: 4.6); move the joints apart"
        )
    legs = manipulator.coarse_legs + manipulator.fine_legs
    for name, leg, length in zip(_list_legs(), legs, lengths, strict=True):
        for part in ("lower", "upper"):
            if not 0.0 <= (distance := getattr(leg, part).com_distance) <= length:
                warnings.append(
                    f"manipulator.{name}.{part}.com_distance: {distance:g} m lies outside of the leg, which is "
                    f"{length:.4g} m long"
                )
    return lines, warnings


def _list_legs() -> list[str]:
    return [f"{kind}[{number}]" for kind in LEGS for number in (1, 2, 3)]


def _list_mm(lengths: Array) -> str:
    return ", ".join(f"{1e3 * length:.1f}" for length in lengths)


def _merge(base: Table, own: Table) -> Table:
    merged = dict(base)
    for key, value in own.items():
        under = base.get(key)
        if key in LEGS and isinstance(under, list):
            merged[key] = _merge_legs(under, value)
        elif isinstance(under, dict) and isinstance(value, dict):
            merged[key] = _merge(under, value)
        else:
            merged[key] = value
    return merged


def _merge_legs(base: list[Table], own: Any) -> Any:
    if isinstance(own, dict):
        own = [own] * len(base)
    if not isinstance(own, list) or len(own) != len(base) or not all(isinstance(leg, dict) for leg in own):
        return own  # refused where the mechanism is built
    return [_merge(under, leg) for under, leg in zip(base, own, strict=True)]


def _scale(manipulator: Table, scale: float) -> Table:
    """The same mechanism with longer legs further apart, of the same masses."""

    def multiply(value: Any, factor: float) -> Any:
        return [factor * number for number in value] if isinstance(value, list) else factor * value

    def scale_leg(leg: Table) -> Table:
        joints = {name: multiply(leg[name], scale) for name in ("base_joint_B", "platform_joint_P")}
        parts = {
            name: leg[name]
            | {
                "com_distance": multiply(leg[name]["com_distance"], scale),
                "radial_inertia": multiply(leg[name]["radial_inertia"], scale**2),
            }
            for name in ("lower", "upper")
        }
        return {**leg, **joints, **parts}

    try:
        lengths = {name: multiply(manipulator[name], scale) for name in ("nominal_translation_B", "coarse_stroke")}
        legs = {kind: [scale_leg(leg) for leg in manipulator[kind]] for kind in LEGS}
    except (KeyError, TypeError) as error:
        raise ParameterError("manipulator.scale", f"the base has no usable mechanism to scale ({error})") from None
    return {**manipulator, **lengths, **legs}


def _name_buses(bus: Table) -> Table:
    """Buses by name: ``[bus]`` itself, or each ``[bus.NAME]`` of a file like paper.toml."""
    if bus and "finite_elements" not in bus and all(isinstance(value, dict) for value in bus.values()):
        return bus
    return {OWN_BUS: bus} if bus else {}


def _complete_bus(own: Table, buses: Table, where: str) -> Table:
    """The entries of one bus, its appendages turned into modes."""
    names = [f.name for f in fields(Bus)]
    refuse_unknown(own, ("base", *names, "appendage", "appendages_included"), where)
    base: Table = {}
    if "base" in own:
        chosen = own.pop("base")
        if not isinstance(chosen, str) or chosen not in buses:
            raise ParameterError(
                f"{where}.base", f"no such bus: {reprlib.repr(chosen)}; the file inherits {', '.join(buses) or 'none'}"
            )
        base = buses[chosen]
    bodies = _read_appendages(own.pop("appendage", []), where)
    included = check_truth(own.pop("appendages_included", True), f"{where}.appendages_included")
    if bodies and "modes" not in own:
        own["modes"] = []
    complete = {"modes": [], **base, **own}
    missing = [key for key in names if key not in complete]
    if missing:
        others = f', or inherit with base = "{DEFAULT_BUS}" in [{where}]' if buses else ""
        raise ParameterError(f"{where}.{missing[0]}", f"missing: give {', '.join(missing)}{others}")
    if bodies:
        modes = [mode for body in bodies for mode in body.make_modes()]
        complete["modes"] = [
            *(complete["modes"] if isinstance(complete["modes"], list) else [complete["modes"]]),
            *({f.name: getattr(mode, f.name) for f in fields(mode)} for mode in modes),
        ]
        if not included:
            complete |= _add_bodies(complete, bodies, where)
    return complete


def _read_appendages(items: Any, where: str) -> list[Appendage]:
    if not isinstance(items, list):
        raise ParameterError(f"{where}.appendage", f"write each as [[{where}.appendage]], got {reprlib.repr(items)}")
    return [build(Appendage, item, f"{where}.appendage[{number}]") for number, item in enumerate(items, 1)]


def _add_bodies(hub: Table, bodies: list[Appendage], where: str) -> Table:
    """Mass, centre of mass and inertia of a hub with its appendages."""
    own = (
        check_number(hub["mass"], f"{where}.mass", above=0.0),
        freeze(hub["com_B"], (3,), f"{where}.com"),
        check_inertia(hub["inertia_B"], f"{where}.inertia"),
    )
    mass, com, inertia = join_bodies([own, *((body.mass, body.com_B, body.inertia_B) for body in bodies)])
    return {"mass": mass, "com_B": com, "inertia_B": np.asarray(inertia)}


def _select_bus(table: Table, name: str | None) -> tuple[str, Table]:
    """Name as errors have it, and entries of the bus."""
    buses: Table = table["bus"]
    if name is None:
        name = OWN_BUS if OWN_BUS in buses else DEFAULT_BUS if DEFAULT_BUS in buses else next(iter(buses))
    if name not in buses:
        raise ParameterError("bus", f"there is no {name!r}; the file has {', '.join(buses)}")
    return ("bus" if name == OWN_BUS else f"bus.{name}"), buses[name]


def _list_inherited(own: Table, whole: Table) -> Iterator[str]:
    """What the file leaves to its base, by the names of ``whole``, which has all: whole tables, then single entries."""
    own = {**own, "payload": dict(own["payload"])} if own.get("payload") else own
    if (payload := own.get("payload", {})).keys() & FLEXIBLE:
        payload |= {"truss_modes": [], "modes": []}
    if "finite_elements" in payload:
        payload |= dict.fromkeys(("mass", "com_P", "inertia_P"))
    known = "com_P" in payload  # the isolator has it from there
    yield from (name for name in TABLES if name not in own and not (name == "isolator" and known))
    for name in (name for name in TABLES if name in own and name != "bus"):
        yield from _list_rest(own[name], whole[name], name)
    for name, entries in _name_buses(own.get("bus", {})).items():
        if "base" in entries:
            where = "bus" if name == OWN_BUS else f"bus.{name}"
            yield from (f"{where}.{f.name}" for f in fields(Bus) if f.name not in entries)


def _list_rest(own: Any, whole: Any, where: str) -> Iterator[str]:
    if isinstance(whole, list) and where.endswith(LEGS):
        legs = own if isinstance(own, list) else [own]
        yield from dict.fromkeys(name for leg in legs for name in _list_rest(leg, whole[0], where))
    elif isinstance(whole, dict) and isinstance(own, dict):
        for key, value in whole.items():
            yield from [f"{where}.{key}"] if key not in own else _list_rest(own[key], value, f"{where}.{key}")
