"""What a report lets its reader explore: verdicts, linked charts, clouds of points, a mechanism that moves.

All numbers are SI; the page chooses engineering units.  Arrays go into the page as base64 of little-endian float32: a
tenth of the time of a list of numbers to read, half its size, and 7 digits are more than a screen shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from ..style import COLOURS
from ..waterfall import RANGE_DB, Waterfall
from .cases import CaseTable
from .writer import Entry, encode, encode_levels, pack_fields

Array = NDArray[np.float64]



@dataclass(frozen=True)
class VerdictRow:
    """One requirement and whether the run meets it: a row at the head of the report, formatted by the caller."""

    requirement: str  # index, signal, window, for example "RPE over 1 s, payload rotation x"
    value: str  # with unit
    limit: str  # with unit
    margin: str  # for example "23 %"
    confidence: str  # for example "95 %"
    answer: str  # "met", "not met"; any other word: the run does not tell
    remark: str = ""  # below the row: why it cannot be said, what to do


@dataclass(frozen=True, eq=False)
class Axis:
    """The common horizontal axis of charts: ascending ``values`` (n,) in ``unit``.

    Raises ``ValueError`` for others.
    """

    label: str
    unit: str
    values: Array
    logarithmic: bool = False

    def __post_init__(self) -> None:
        if np.ndim(self.values) != 1 or not len(self.values) or not np.all(np.diff(self.values) > 0.0):
            raise ValueError(f"axis {self.label!r}: expected ascending values")
        if self.logarithmic and self.values[0] <= 0.0:
            raise ValueError(f"axis {self.label!r}: expected values above 0, got {self.values[0]:g}")

    def pack(self) -> Entry:
        """As the page reads it; equally spaced values as start and step, which float32 could not hold for long runs."""
        values = np.asarray(self.values, dtype=float)
        packed: Entry = {"label": self.label, "unit": self.unit, "logarithmic": self.logarithmic, "count": len(values)}
        step = (values[-1] - values[0]) / max(len(values) - 1, 1)
        even = values[0] + step * np.arange(len(values))
        if np.abs(values - even).max() <= 1e-6 * max(step, 1e-300):
            return {**packed, "start": float(values[0]), "step": float(step)}
        return {**packed, "values": encode(values)}


@dataclass(frozen=True, eq=False)
class Curve:
    """One signal over an axis: ``low`` (n,), and ``high`` (n,) where each value stands for a span of the run."""

    label: str
    colour: str  # one of style.COLOURS
    low: Array
    high: Array | None = None
    drawn: str = "line"  # or dashed, dotted, dots, steps: of values that are held

    def __post_init__(self) -> None:
        if self.colour not in COLOURS:
            raise ValueError(f"curve {self.label!r}: expected a colour of {', '.join(COLOURS)}, got {self.colour!r}")

    @property
    def ends(self) -> tuple[Array, Array]:
        """Lowest and highest values."""
        return self.low, self.low if self.high is None else self.high


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves of one quantity; ``unit`` is that of FMI: rad, m, rad2/Hz, 1."""

    title: str
    unit: str
    curves: Sequence[Curve]
    logarithmic: bool = False


@dataclass(frozen=True)
class Spans:
    """Spans of an axis in which something holds, shaded in every chart: the legend's text, spans, colour."""

    label: str
    spans: Sequence[tuple[float, float]]
    colour: str = "reference"
    opacity: float = 0.1


@dataclass(frozen=True)
class Still:
    """A PNG file of a group: its name, and what of the group it shows."""

    file: str
    title: str = ""
    """Where it is not that of the group."""
    curves: Sequence[str] = ()
    """Labels; none: all."""
    charts: int | None = None
    """The first so many; None: all."""
    enlarged: str = ""
    """Label of a curve that is drawn once more, alone, beside each chart."""
    caption: str = ""
    """Where it is not that of the group."""


@dataclass(frozen=True, eq=False)
class ChartGroup:
    """Charts over one axis that are zoomed and read together.

    Raises ``ValueError`` for a curve that does not have a value for each of the axis.
    """

    title: str
    caption: str
    axis: Axis
    charts: Sequence[Chart]
    shaded: Sequence[Spans] = ()
    marked: Sequence[tuple[str, float]] = ()
    """Places of the axis with a line across: the legend's text, and where."""
    stills: Sequence[Still] = ()
    alone: str = ""
    """Label of a curve that has a second chart beside each, with a scale of its own."""

    def __post_init__(self) -> None:
        for chart in self.charts:
            for curve in chart.curves:
                if any(np.shape(values) != np.shape(self.axis.values) for values in curve.ends):
                    expected = f"expected {len(self.axis.values)} values of {curve.label!r}"
                    raise ValueError(f"chart {chart.title!r}: {expected}")

    @property
    def columns(self) -> int:
        """How many charts stand beside one another: three where there are several rows of these."""
        if self.alone:
            return 2
        return 3 if len(self.charts) > 3 and len(self.charts) % 3 == 0 else 1

    def pack(self) -> Entry:
        """As the page reads it."""
        shown = {name: value for name, value in pack_fields(self).items() if name not in ("stills", "caption")}
        return {**shown, "columns": self.columns}


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a plane, ``points`` (n, 2), and the corners of their ``hull`` (m, 2), about their mean."""

    label: str
    colour: str
    points: Array
    hull: Array


@dataclass(frozen=True, eq=False)
class CloudGroup:
    """Clouds in one plane, and the name of their PNG file, if there is to be one."""

    title: str
    caption: str
    unit: str
    clouds: Sequence[Cloud]
    file: str = ""


@dataclass(frozen=True, eq=False)
class Motion:
    """One run of the mechanism, n instants ``time`` (n,), s.

    Small motions (n, 3): displacements in axes of B [m], rotation vectors of the base in B and of the payload in P
    [rad].  The nominal pose of the payload is (n, 3) or, where it stays, (1, 3): origin of P in B [m] and roll, pitch,
    yaw [rad].  Raises ``ValueError`` for other shapes.
    """

    label: str
    time: Array
    base_position: Array
    base_rotation: Array
    payload_position: Array
    payload_rotation: Array
    nominal_position: Array
    nominal_orientation: Array

    def __post_init__(self) -> None:
        for field in fields(self)[2:]:
            shape = np.shape(getattr(self, field.name))
            if shape not in {(len(self.time), 3), (1, 3)}:
                raise ValueError(f"motion {self.label!r}: {field.name} has the shape {shape}")

    def pack(self) -> Entry:
        """As the page reads it."""
        return {**pack_fields(self), "time": Axis("time", "s", self.time).pack()}


@dataclass(frozen=True, eq=False)
class Mechanism:
    """Base, six legs and payload, turned and played by the reader.

    ``base_joints`` (6, 3) in B and ``platform_joints`` (6, 3) in P, m; coarse legs 1..3, then fine legs 1..3.
    """

    title: str
    caption: str
    base_joints: Array
    platform_joints: Array
    motions: Sequence[Motion]


@dataclass(frozen=True, eq=False)
class Exploration:
    """All that a report lets its reader explore."""

    charts: Sequence[ChartGroup] = ()
    clouds: Sequence[CloudGroup] = ()
    mechanism: Mechanism | None = None
    waterfalls: Sequence[Waterfall] = ()
    cases: CaseTable | None = None

    def pack(self) -> Entry:
        """As the page reads it; empty if there is nothing."""
        if not (self.charts or self.clouds or self.mechanism or self.waterfalls or self.cases):
            return {}
        return {**pack_fields(self), "waterfalls": [_pack_waterfall(shown) for shown in self.waterfalls]}


def _pack_waterfall(shown: Waterfall) -> Entry:
    return {
        "unit": shown.unit,
        "largest": shown.largest,
        "rangeDb": RANGE_DB,
        "frequency": Axis("frequency", "Hz", shown.frequency).pack(),
        "ordinate": Axis(shown.label, shown.ordinate_unit, shown.ordinate).pack(),
        "shown": shown.shown,
        "panels": [
            {
                "case": panel.case,
                "levels": encode_levels(shown.levels(panel), -RANGE_DB),
                "mark": None if panel.mark is None else pack_fields(panel.mark),
            }
            for panel in shown.panels
        ],
        "lines": [pack_fields(line) for line in shown.lines],
        "modes": [pack_fields(mode) for mode in shown.modes],
    }
