"""What a scheme records beside the outputs: iterations and residuals of loops, estimates of the error."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from fmpy.model_description import ModelDescription

from ..rows import Column, OwnColumn, RowLayout, make_layout
from ..structure import PortName, System
from .resolving import list_loops
from .scheme import Scheme


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
    """The columns of a scheme, and the layout of all; arguments as of :func:`..rows.make_layout`."""
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
