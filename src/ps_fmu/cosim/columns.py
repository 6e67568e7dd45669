"""Which outputs a run reads and records: all, or those that somebody needs."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from fmpy.model_description import ModelDescription

from .errors import UsageError
from .rows import Derived, RowLayout, make_layout
from .signals import BoundSignal, derive_outputs
from .structure import PortName, System, suggest_names


def choose_columns(
    system: System,
    descriptions: Mapping[str, ModelDescription],
    signals: Sequence[BoundSignal],
    also: Collection[PortName] = (),
    only: Collection[str] | None = None,
) -> tuple[RowLayout, list[Derived]]:
    """The columns of the rows, and those that are computed from them.

    Parameters
    ----------
    signals: inputs of the run, which are recorded in any case
    also: variables to record beside the outputs
    only: names of columns to record; what connections carry is read, too, and is a column.  None: all.  The columns
        keep their order and their names.

    Raises :class:`UsageError` for a name in ``only`` that no column has.
    """
    wired = {connection.source for connection in system.connections}
    more = wired | {item.source for item in system.outputs} | set(also)
    layout = make_layout(descriptions, more, signals)
    derived = derive_outputs(system, descriptions, layout.columns)
    if only is None:
        return layout, derived
    names = [column.name for column in layout.columns]
    known = {*names, *(item.column.name for item in derived)}
    for name in only:
        if name not in known:
            raise UsageError(f"only: there is no column {name!r}{suggest_names(name, known)}")
    wanted = set(only)
    shown = [item for item in derived if item.column.name in wanted]
    wanted |= {names[item.place] for item in shown}
    ports = (*layout.real, *layout.discrete)
    less = make_layout(descriptions, more, signals, wired | {port for port in ports if str(port) in wanted})
    places = {column.name: place for place, column in enumerate(less.columns)}
    return less, [replace(item, place=places[names[item.place]]) for item in shown]
