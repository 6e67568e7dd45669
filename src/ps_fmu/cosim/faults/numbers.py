"""Other numbers in the events of a file of faults, as a study has them in each case: ``EVENT.value``, ``EVENT.time``.

EVENT is the name of an event, or its number in the file, from 0 on as in messages.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from fmpy.model_description import ModelDescription, ModelVariable

from ..description import find_variable, get_unit
from ..errors import SystemFileError
from ..structure import suggest_names
from ..values import Value
from .reading import BIAS, DELAY, DROPOUT, NOISE, RESET, SCALE, FaultEvent, FaultFile

_FIELDS = {
    "time": "time_s", "duration": "duration_s", "value": "value", "rms": "rms", "density": "density",
    "probability": "probability", "seed": "seed",
}  # fmt: skip
_LARGEST_INT = 2**31 - 1
_FACTOR = re.compile(r"([^\W\d_]+|%|\u00b0)\^?([+-]?\d)?")


def list_numbers(event: FaultEvent) -> tuple[str, ...]:
    """The keys of an event whose values can be others: those that it states, or that have a default."""
    found = [key for key in ("time", "duration", "rms", "density") if getattr(event, _FIELDS[key]) is not None]
    if event.value is not None and event.action != RESET:
        found.append("value")
    if event.action == DROPOUT:
        found.append("probability")
    if event.action == NOISE or (event.action == DROPOUT and event.probability < 1.0):
        found.append("seed")
    return tuple(found)


def find_number(file: FaultFile, name: str, descriptions: Mapping[str, ModelDescription]) -> ModelVariable:
    """The number ``EVENT.KEY`` as a variable: its type, unit, bounds, and what the file states as start.

    The variable has the name of the event, or its number where it has none, whichever of both ``name`` has.

    Raises :class:`SystemFileError` with the line: no such event, or none that has the key; :class:`UsageError` for an
    event on a variable that the system has not.
    """
    place, key = _take_apart(file, name)
    event = file.events[place]
    name, start = f"{event.name or place}.{key}", getattr(event, _FIELDS[key])
    if key == "seed":
        return _make(name, "Integer", "1", start, "0", str(_LARGEST_INT))
    if key in ("time", "duration") or (key == "value" and event.action == DELAY):
        return _make(name, "Real", "s", start, "0")
    if key == "probability":
        return _make(name, "Real", "1", start, "0", "1")
    if key == "value" and event.action == SCALE:
        return _make(name, "Real", "1", start)
    signal = find_variable(descriptions[event.signal.component], event.signal.variable)
    unit = get_unit(signal) or "1"
    if key == "value" and event.action == BIAS:
        return _make(name, signal.type, unit, start)
    if key == "value":
        return _make(name, signal.type, unit, start, signal.min, signal.max)
    return _make(name, "Real", unit if key == "rms" else _make_density_unit(unit), start, "0")


def change_numbers(file: FaultFile, values: Mapping[str, Value]) -> FaultFile:
    """The faults with other numbers, ``EVENT.KEY``.

    Raises :class:`SystemFileError` with the line: no such number, an event that is not before the end of all.  All else
    is checked when the faults are bound to their system.
    """
    events = list(file.events)
    for name, value in values.items():
        place, key = _take_apart(file, name)
        changed: dict[str, Any] = {_FIELDS[key]: value}
        events[place] = replace(events[place], **changed)
    found = replace(file, events=tuple(events))
    found.check_end()
    return found


def _take_apart(file: FaultFile, name: str) -> tuple[int, str]:
    """The place of the event in the file, and the key."""
    label, dot, key = name.rpartition(".")
    if not dot:
        raise SystemFileError(file.path, f"{name}: expected an event and a key of it, such as {name}.value")
    places = {event.name: place for place, event in enumerate(file.events) if event.name}
    place = places.get(label)
    if place is None and label.isdecimal() and label.isascii() and int(label) < len(file.events):
        place = int(label)
    if place is None:
        named = f"one of the names {', '.join(places)}" if places else "a name, but no event states one"
        text = f"there is no event {label!r}: expected a number from 0 to {len(file.events) - 1}, or {named}"
        raise SystemFileError(file.path, f"{text}{suggest_names(label, places)}")
    event = file.events[place]
    known = list_numbers(event)
    if key not in known:
        text = f"there is no number {key!r} in the event; expected one of {', '.join(known)}{suggest_names(key, known)}"
        raise file.error(event, text)
    return place, key


def _make(
    name: str, kind: str, unit: str, start: object, low: str | None = None, high: str | None = None
) -> ModelVariable:
    return ModelVariable(
        name=name, valueReference=0, type=kind, unit=unit, start=str(start), min=low, max=high, causality="parameter",
        variability="fixed",
    )  # fmt: skip


def _make_density_unit(unit: str) -> str:
    """Of a power spectral density: ``rad2/s4/Hz`` of ``rad/s2``."""
    return _FACTOR.sub(lambda found: f"{found[1]}{2 * int(found[2] or 1)}", unit) + "/Hz"
