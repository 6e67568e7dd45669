"""Which outputs a run reads and records: all, or those that somebody needs; and what a scheme adds to them."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

from fmpy.model_description import ModelDescription

from .errors import UsageError
from .rows import Column, OwnColumn, RowLayout, Rows, make_layout
from .schemes.resolving import list_loops, resolve_scheme
from .schemes.scheme import Scheme, make_scheme
from .signals import BoundSignal, Signal, bind_signals, derive_outputs
from .structure import PortName, System, suggest_names


class RunColumns:
    """The columns of a run: what is read of the FMUs, and what is computed from that.

    Parameters
    ----------
    signals: inputs of the run, which are recorded in any case
    scheme: resolved for the system; its own columns are recorded in any case
    also: variables to record beside the outputs
    only: as for :meth:`choose`
    """

    def __init__(
        self,
        system: System,
        descriptions: Mapping[str, ModelDescription],
        signals: Sequence[BoundSignal],
        scheme: Scheme,
        also: Collection[PortName] = (),
        only: Collection[str] | None = None,
    ) -> None:
        self._wired = {connection.source for connection in system.connections}
        self._more = self._wired | {item.source for item in system.outputs} | set(also)
        self.own, self._all = lay_out(scheme, system, descriptions, self._more, signals)
        """Those of the scheme."""
        self._layout, self._descriptions, self._estimates = self._all, descriptions, scheme.error_estimate
        self._signals: tuple[OwnColumn, ...] = (*signals, *self.own)
        self._derived = self._all_derived = derive_outputs(system, descriptions, self._all.columns)
        self.choose(only)

    @property
    def every(self) -> tuple[Column, ...]:
        """All columns, in the order of those of a block."""
        return (*self._layout.columns, *(item.column for item in self._derived))

    def choose(self, only: Collection[str] | None) -> None:
        """Leave out all columns but those of these names and what connections carry; None: none is left out.

        Order, names and values of the others stay.  A scheme that estimates errors reads all outputs for that, and none
        is left out.  Raises :class:`UsageError` for a name that no column has.
        """
        if only is None:
            self._layout, self._derived = self._all, self._all_derived
            return
        names = [column.name for column in self._all.columns]
        known = [*names, *(item.column.name for item in self._all_derived)]
        for name in only:
            if name not in known:
                raise UsageError(f"only: there is no column {name!r}{suggest_names(name, known)}")
        if self._estimates:
            return
        wanted = set(only)
        shown = [item for item in self._all_derived if item.column.name in wanted]
        wanted |= {names[item.place] for item in shown}
        ports = {port for port in (*self._all.real, *self._all.discrete) if str(port) in wanted}
        self._layout = make_layout(self._descriptions, self._more, self._signals, self._wired | ports)
        places = {column.name: place for place, column in enumerate(self._layout.columns)}
        self._derived = [replace(item, place=places[names[item.place]]) for item in shown]

    def make_rows(self, capacity: int) -> Rows:
        """Room for so many rows at a time.  Raises :class:`UsageError` for none."""
        if capacity < 1:
            raise UsageError(f"block_rows: expected at least 1, got {capacity!r}")
        return Rows(self._layout, capacity, self._derived)


def list_run_columns(
    system: System,
    descriptions: Mapping[str, ModelDescription],
    inputs: Mapping[str, Signal],
    scheme: str | Scheme,
    step: float,
    also: Collection[PortName] = (),
) -> tuple[Column, ...]:
    """What a run of a system with a ``step`` [s] can record, in order; ``also``: beside the outputs, as of faults.

    Raises :class:`UsageError`: inputs or outputs of the system, or a scheme, that cannot be.
    """
    resolved = resolve_scheme(make_scheme(scheme), system, descriptions, step)
    return RunColumns(system, descriptions, bind_signals(system, descriptions, inputs), resolved, also).every


@dataclass(frozen=True)
class SchemeColumn:
    """A column without a component.  ``members`` are the components that it is about, ``kind`` says what of them."""

    kind: str
    members: tuple[str, ...]
    column: Column

    @property
    def port(self) -> PortName:
        """Its name in the rows."""
        return PortName("", self.column.name)


_TEXTS = {
    "passes": "how often the loop of {} was stepped, those for its Jacobian included",
    "residual": "largest difference of what goes into the loop of {} and what comes out, in units of its tolerance",
    "error_estimate": "local error of {} by step doubling, relative to the largest value of the output so far",
}


def lay_out(
    scheme: Scheme,
    system: System,
    descriptions: Mapping[str, ModelDescription],
    more: Collection[PortName],
    signals: Sequence[OwnColumn],
) -> tuple[list[SchemeColumn], RowLayout]:
    """The columns of a scheme, and the layout of all; arguments as of :func:`.rows.make_layout`."""
    layout = make_layout(descriptions, more, signals)
    own = list_columns(scheme, system, [column.name for column in layout.columns])
    return own, make_layout(descriptions, more, (*signals, *own)) if own else layout


def list_columns(scheme: Scheme, system: System, taken: Collection[str]) -> list[SchemeColumn]:
    """The columns of a scheme; their names differ from those that are ``taken``."""
    found = []
    for number, members in enumerate(list_loops(system) if scheme.is_iterated else (), 1):
        for kind in ("passes", "residual"):
            found.append(_make_column(kind, f"loop_{number}.{kind}", members, taken))
    if scheme.error_estimate:
        for component in system.components:
            name = f"error_estimate.{component.name}"
            found.append(_make_column("error_estimate", name, (component.name,), taken))
    return found


def _make_column(kind: str, name: str, members: tuple[str, ...], taken: Collection[str]) -> SchemeColumn:
    while name in taken:
        name += "_"
    return SchemeColumn(kind, members, Column(name, "1", "Real", _TEXTS[kind].format(", ".join(members))))
