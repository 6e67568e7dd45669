"""What a report lets its reader explore: verdicts, linked charts, clouds of points, a mechanism that moves.

All numbers are SI; the page chooses engineering units.  Arrays go into the page as base64 of little-endian float32: a
tenth of the time of a list of numbers to read, half its size, and 7 digits are more than a screen shows.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..waterfall import RANGE_DB, Waterfall
from .cases import CaseTable
from .packing import encode, encode_levels

Array = NDArray[np.float64]
Entry = dict[str, object]

COLOURS = ("passive", "active", "reference", "x", "y", "z")
"""Names of the page's colours, each with a value for a light and for a dark page (page.css)."""


@dataclass(frozen=True)
class Verdict:
    """One requirement and whether the run meets it: a row at the head of the report, formatted by the caller."""

    requirement: str  # index, signal, window, for example "RPE over 1 s, payload rotation x"
    value: str  # with unit
    limit: str  # with unit
    margin: str  # for example "23 %"
    confidence: str  # for example "95 %"
    met: bool | None  # None: the run cannot tell


@dataclass(frozen=True, eq=False)
class Axis:
    """The common horizontal axis of charts: ascending ``values`` (n,) in ``unit``."""

    label: str
    unit: str
    values: Array
    logarithmic: bool = False

    def pack(self) -> Entry:
        """As the page reads it; equally spaced values as start and step, which float32 could not hold for long runs."""
        values = np.asarray(self.values, dtype=float)
        if values.ndim != 1 or not len(values) or not np.all(np.diff(values) > 0.0):
            raise ValueError(f"axis {self.label!r}: expected ascending values")
        if self.logarithmic and values[0] <= 0.0:
            raise ValueError(f"axis {self.label!r}: expected values above 0, got {values[0]:g}")
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
    colour: str  # one of COLOURS
    low: Array
    high: Array | None = None

    def __post_init__(self) -> None:
        if self.colour not in COLOURS:
            raise ValueError(f"curve {self.label!r}: expected a colour of {', '.join(COLOURS)}, got {self.colour!r}")

    def pack(self) -> Entry:
        """As the page reads it."""
        packed: Entry = {"label": self.label, "colour": self.colour, "low": encode(self.low)}
        return packed if self.high is None else {**packed, "high": encode(self.high)}


@dataclass(frozen=True, eq=False)
class Chart:
    """Curves of one quantity; ``unit`` is that of FMI: rad, m, rad2/Hz, 1."""

    title: str
    unit: str
    curves: Sequence[Curve]
    logarithmic: bool = False

    def pack(self, count: int) -> Entry:
        """As the page reads it; raises ``ValueError`` for a curve that does not have ``count`` values."""
        for curve in self.curves:
            for values in (curve.low, curve.high):
                if values is not None and np.shape(values) != (count,):
                    raise ValueError(f"chart {self.title!r}: expected {count} values of {curve.label!r}")
        curves = [curve.pack() for curve in self.curves]
        return {"title": self.title, "unit": self.unit, "logarithmic": self.logarithmic, "curves": curves}


@dataclass(frozen=True, eq=False)
class ChartGroup:
    """Charts over one axis that are zoomed and read together."""

    title: str
    caption: str
    axis: Axis
    charts: Sequence[Chart]

    def pack(self) -> Entry:
        """As the page reads it."""
        axis = self.axis.pack()
        return {"axis": axis, "charts": [chart.pack(len(self.axis.values)) for chart in self.charts]}


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points of a plane, ``points`` (n, 2), and the corners of their ``hull`` (m, 2), about their mean."""

    label: str
    colour: str
    points: Array
    hull: Array

    def pack(self) -> Entry:
        """As the page reads it."""
        return {
            "label": self.label, "colour": self.colour, "points": encode(self.points), "hull": encode(self.hull),
        }  # fmt: skip


@dataclass(frozen=True, eq=False)
class CloudGroup:
    """Clouds in one plane."""

    title: str
    caption: str
    unit: str
    clouds: Sequence[Cloud]

    def pack(self) -> Entry:
        """As the page reads it."""
        return {"unit": self.unit, "clouds": [cloud.pack() for cloud in self.clouds]}


@dataclass(frozen=True, eq=False)
class Motion:
    """One run of the mechanism, n instants ``time`` (n,), s.

    Small motions (n, 3): displacements in axes of B [m], rotation vectors of the base in B and of the payload in P
    [rad].  The nominal pose of the payload is (n, 3) or, where it stays, (1, 3): origin of P in B [m] and roll, pitch,
    yaw [rad].
    """

    label: str
    time: Array
    base_position: Array
    base_rotation: Array
    payload_position: Array
    payload_rotation: Array
    nominal_position: Array
    nominal_orientation: Array

    def pack(self) -> Entry:
        """As the page reads it."""
        arrays = {
            "basePosition": self.base_position, "baseRotation": self.base_rotation,
            "payloadPosition": self.payload_position, "payloadRotation": self.payload_rotation,
            "nominalPosition": self.nominal_position, "nominalOrientation": self.nominal_orientation,
        }  # fmt: skip
        for name, values in arrays.items():
            if np.shape(values) not in {(len(self.time), 3), (1, 3)}:
                raise ValueError(f"motion {self.label!r}: {name} has the shape {np.shape(values)}")
        time = Axis("time", "s", self.time).pack()
        return {"label": self.label, "time": time, **{name: encode(values) for name, values in arrays.items()}}


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

    def pack(self) -> Entry:
        """As the page reads it."""
        return {
            "baseJoints": encode(self.base_joints),
            "platformJoints": encode(self.platform_joints),
            "motions": [motion.pack() for motion in self.motions],
        }


@dataclass(frozen=True, eq=False)
class Exploration:
    """All that a report lets its reader explore."""

    charts: Sequence[ChartGroup] = ()
    clouds: Sequence[CloudGroup] = ()
    mechanism: Mechanism | None = None
    waterfalls: Sequence[Waterfall] = ()
    cases: CaseTable | None = None

    def pack(self) -> Entry:
        """As the page reads it; empty if there is nothing.  Raises ``ValueError`` for arrays that do not fit."""
        if not (self.charts or self.clouds or self.mechanism or self.waterfalls or self.cases):
            return {}
        return {
            "groups": [group.pack() for group in self.charts],
            "clouds": [group.pack() for group in self.clouds],
            "mechanism": self.mechanism.pack() if self.mechanism else None,
            "waterfalls": [_pack_waterfall(shown) for shown in self.waterfalls],
            "cases": self.cases.pack() if self.cases else None,
        }


def _pack_waterfall(shown: Waterfall) -> Entry:
    ordinate = Axis(shown.label, shown.ordinate_unit, shown.ordinate).pack()
    return {
        "unit": shown.unit,
        "largest": shown.largest,
        "rangeDb": RANGE_DB,
        "frequency": Axis("frequency", "Hz", shown.frequency).pack(),
        "ordinate": ordinate,
        "shown": shown.shown,
        "panels": [
            {
                "case": panel.case,
                "levels": encode_levels(shown.levels(panel), -RANGE_DB),
                "mark": None
                if panel.mark is None
                else {"frequency": panel.mark.frequency, "ordinate": panel.mark.ordinate},
            }
            for panel in shown.panels
        ],
        "lines": [
            {"wheel": line.wheel, "order": line.order, "frequency": encode(line.frequency)} for line in shown.lines
        ],
        "modes": [{"name": mode.name, "frequency": mode.frequency} for mode in shown.modes],
    }
