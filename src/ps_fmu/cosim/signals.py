"""Inputs of a run over time, and the connectors of the system that show outputs.

An input is held or interpolated as the variables that it feeds say: linearly where they are all continuous, else held.
Before the first and after the last row it keeps that value.
"""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from fmpy.model_description import ModelDescription
from numpy.typing import NDArray

from ..files.plain import read_bytes
from .conversion import INTEGERS, combine, find_end
from .description import find_variable
from .errors import SystemFileError, UsageError
from .rows import Array, Column, Derived
from .structure import PortName, System, SystemInput, suggest_names
from .values import Conversion, End, Value, fits_int32, list_items, parse_value

AT_ONCE = 1e-6
"""A row so many steps after a communication point counts as there: decimal fractions are not exact."""
MAXIMUM_BYTES = 256 * 2**20


@dataclass(frozen=True)
class Signal:
    """Times (rows,) [s], which do not decrease, and the values (rows,) as texts of the file ``origin``."""

    times: Array
    texts: Sequence[str]
    lines: Sequence[int]
    origin: str


@dataclass(frozen=True, eq=False)
class BoundSignal:
    """A signal with what it feeds.  ``port`` is its name in the rows."""

    port: PortName
    type: str
    unit: str
    times: Array
    values: NDArray[np.float64]
    linear: bool
    targets: tuple[tuple[PortName, Conversion], ...]

    @property
    def column(self) -> Column:
        """How it is recorded."""
        return Column(str(self.port), self.unit, self.type, "input of the run")

    def sample(self, times: Array, step: float) -> Array:
        """Values at some times [s] of a run with a step [s]; of two rows at one time the later counts."""
        place = np.searchsorted(self.times, times + AT_ONCE * step, "right") - 1
        low = np.clip(place, 0, len(self.times) - 1)
        if not self.linear:
            return self.values[low]
        high = np.minimum(low + 1, len(self.times) - 1)
        span = self.times[high] - self.times[low]
        share = np.divide(times - self.times[low], span, out=np.zeros(len(times)), where=span > 0.0)
        share = np.where(place < 0, 0.0, np.clip(share, 0.0, 1.0))
        return self.values[low] + share * (self.values[high] - self.values[low])


def read_signals(path: Path) -> dict[str, Signal]:
    """Inputs of a CSV file by name: a head with ``time`` and the names, then a row for each time, with commas.

    Raises :class:`SystemFileError` with the line: no such head, a row of another length, times that are no numbers or
    decrease, no rows.
    """
    try:
        text = read_bytes(path, MAXIMUM_BYTES).decode("utf-8-sig")
    except UnicodeError as error:
        raise SystemFileError(path, f"is not in UTF-8, save it as such: {error}") from error
    rows = csv.reader(io.StringIO(text, newline=None), skipinitialspace=True)
    try:
        head = [name.strip() for name in next(rows, [])]
        if reason := _find_fault(head):
            text = f"expected a head such as time,input_1,input_2 with different names: {reason}"
            raise SystemFileError(path, text, 1)
        table: list[tuple[float, list[str]]] = []
        lines = []
        for row in rows:
            if not row:
                continue
            if len(row) != len(head):
                raise SystemFileError(path, f"expected {len(head)} values, got {len(row)}", rows.line_num)
            time = parse_value("Real", row[0])
            if not isinstance(time, float) or (table and time < table[-1][0]):
                text = f"expected a time in seconds that does not decrease, got {row[0]!r}"
                raise SystemFileError(path, text, rows.line_num)
            table.append((time, row[1:]))
            lines.append(rows.line_num)
    except csv.Error as error:
        raise SystemFileError(path, f"is not a CSV file: {error}", rows.line_num) from error
    if not table:
        raise SystemFileError(path, "expected rows below the head", 1)
    times = np.array([time for time, _ in table])
    return {
        name: Signal(times, [texts[place] for _, texts in table], lines, str(path))
        for place, name in enumerate(head[1:])
    }


def _find_fault(head: Sequence[str]) -> str | None:
    """What is wrong with the first line of a file of inputs; None if nothing is."""
    if head[:1] != ["time"]:
        if len(head) == 1 and set(head[0]) & set(";\t"):
            return "the columns are not separated by commas"
        return f"the first column is called {head[0]!r}" if head else "the file is empty"
    if len(head) < 2:
        return "there is no input"
    again = next((name for place, name in enumerate(head) if name in head[:place]), None)
    if again is not None:
        return f"{again!r} occurs twice"
    return f"column {head.index('') + 1} has no name" if "" in head else None


def bind_signals(
    system: System, descriptions: Mapping[str, ModelDescription], signals: Mapping[str, Signal]
) -> list[BoundSignal]:
    """Signals with the inputs of components that they feed.

    A name is that of an input of the system, or ``component.variable`` of an input that no connection feeds.  Raises
    :class:`UsageError`: no such input, one that is connected, one of Strings, two for one variable; an input of the
    system, fed or not, whose type is another than that of what it leads to, or whose unit cannot be converted;
    :class:`SystemFileError` with the line: a value of another type, or none of the enumeration.
    """
    inputs = {item.name: convert_input(system, item, descriptions) for item in system.inputs}
    connected = {connection.target for connection in system.connections}
    bound = []
    owners: dict[PortName, str] = {}
    for name, signal in signals.items():
        if name in inputs:
            start, targets = inputs[name]
        else:
            try:
                port = _find_open(system, descriptions, name, [*inputs], connected)
            except UsageError as error:
                raise UsageError(f"{signal.origin}, line 1: {error}") from None
            start, targets = _find_end(port, descriptions), ((port, Conversion()),)
        for port, _ in targets:
            if (other := owners.setdefault(port, name)) != name:
                raise UsageError(f"{signal.origin}, line 1: {other!r} and {name!r} both feed {port}: leave one out")
        bound.append(_bind(name, signal, start, targets, descriptions))
    return bound


def get_first_values(signals: Sequence[BoundSignal], start: float, step: float) -> dict[PortName, Value]:
    """What the signals give the inputs of components at the start [s] of a run with a step [s]."""
    types: dict[str, type[float | int | bool]] = {"Real": float, "Boolean": bool}
    return {
        port: conversion.apply(types.get(signal.type, int)(signal.sample(np.array([start]), step)[0]))
        for signal in signals
        for port, conversion in signal.targets
    }


def convert_input(
    system: System, item: SystemInput, descriptions: Mapping[str, ModelDescription]
) -> tuple[End, tuple[tuple[PortName, Conversion], ...]]:
    """What an input of the system is; the inputs of components that it leads to, with what is done on the way.

    Raises :class:`UsageError` as :func:`bind_signals`.
    """
    ends = [_find_end(port, descriptions) for port, _ in item.targets]
    start = End(item.end.type or ends[0].type, item.end.unit or ends[0].unit, item.end.items or ends[0].items)
    targets = []
    for (port, hops), end in zip(item.targets, ends, strict=True):
        try:
            if start.type != end.type and {start.type, end.type} != set(INTEGERS):
                raise ValueError(f"line {item.line}: it is {start.type}, and {port}, which it leads to, {end.type}")
            targets.append((port, combine(start, hops, end)))
        except ValueError as error:
            raise UsageError(f"{system.path}: input {item.name!r} of the system: {error}") from None
    return start, tuple(targets)


def _bind(
    name: str,
    signal: Signal,
    start: End,
    targets: tuple[tuple[PortName, Conversion], ...],
    descriptions: Mapping[str, ModelDescription],
) -> BoundSignal:
    kind = "Integer" if start.type == "Enumeration" else start.type or "Real"
    if kind == "String":
        raise UsageError(f"{signal.origin}, line 1: input {name!r}: Strings cannot be read here: set a start value")
    values = np.empty(len(signal.texts))
    for row, text in enumerate(signal.texts):
        value = (start.items or {}).get(text.strip(), parse_value(kind, text))  # an item by its name or its number
        if value is None or isinstance(value, str) or (kind == "Integer" and not fits_int32(int(value))):
            text = f"input {name!r}: expected a value of type {start.type}, got {text!r}"
            raise SystemFileError(Path(signal.origin), text, signal.lines[row])
        if start.items and value not in start.items.values():
            text = f"input {name!r}: expected an item of the enumeration, {list_items(start.items)}, got {value}"
            raise SystemFileError(Path(signal.origin), text, signal.lines[row])
        values[row] = value
    variables = [find_variable(descriptions[port.component], port.variable) for port, _ in targets]
    linear = kind == "Real" and all(variable.variability in (None, "continuous") for variable in variables)
    if linear:
        _check_spans(name, signal, values)
    unit = start.unit.name if start.unit is not None else "1"
    return BoundSignal(PortName("", name), start.type or "Real", unit, signal.times, values, linear, targets)


def _check_spans(name: str, signal: Signal, values: NDArray[np.float64]) -> None:
    """Raises :class:`SystemFileError` with the line where a line cannot be drawn from the row before."""
    for row, (before, value) in enumerate(pairwise(values.tolist()), 1):
        begin, end = signal.times[row - 1 : row + 1].tolist()
        if not (math.isfinite(value - before) and math.isfinite(end - begin)):
            text = (
                f"input {name!r}: expected smaller steps than from {before:g} at {begin:g} s to {value:g} at {end:g} "
                "s, which cannot be interpolated"
            )
            raise SystemFileError(Path(signal.origin), text, signal.lines[row])


def _find_open(
    system: System,
    descriptions: Mapping[str, ModelDescription],
    name: str,
    inputs: Sequence[str],
    connected: set[PortName],
) -> PortName:
    try:
        port = system.find_port(name)
        variable = find_variable(descriptions[port.component], port.variable)
    except UsageError:
        known = [*inputs, *_list_open(system, descriptions, connected)]
        hint = suggest_names(name, known) or f"; there are {', '.join(known[:20]) or 'none'}"
        raise UsageError(f"input {name!r}: there is no such input in the system{hint}") from None
    if variable.causality != "input" or port in connected:
        what = "is connected" if port in connected else f"is not an input, its causality is {variable.causality}"
        raise UsageError(f"input {name!r}: the variable {what}: expected an input that nothing feeds")
    return port


def _list_open(
    system: System, descriptions: Mapping[str, ModelDescription], connected: set[PortName]
) -> list[str]:
    ports = [
        PortName(name, variable.name)
        for name, description in descriptions.items()
        for variable in description.modelVariables
        if variable.causality == "input"
    ]
    return [str(port) for port in ports if port not in connected]


def _find_end(port: PortName, descriptions: Mapping[str, ModelDescription]) -> End:
    description = descriptions[port.component]
    return find_end(find_variable(description, port.variable), description)


def derive_outputs(
    system: System, descriptions: Mapping[str, ModelDescription], columns: Sequence[Column]
) -> list[Derived]:
    """The columns of the system's output connectors.  Raises :class:`UsageError` for units that cannot be converted."""
    places = {column.name: place for place, column in enumerate(columns)}
    derived = []
    for item in system.outputs:
        place = places.get(str(item.source))
        if place is None:  # a String
            continue
        start = _find_end(item.source, descriptions)
        unit = item.end.unit or start.unit
        end = End(item.end.type or start.type, unit, item.end.items or start.items)
        try:
            conversion = combine(start, item.hops, end)
        except ValueError as error:
            raise UsageError(f"{system.path}: output {item.name!r} of the system: {error}") from None
        name = item.name if item.name not in places else f"{item.name} (output of the system)"
        column = Column(name, unit.name if unit else "1", columns[place].type, f"{item.source}, as the system shows it")
        derived.append(Derived(column, place, conversion))
    return derived
