"""Scatter of the image point: where the line of sight falls on the image plane during a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...reduction.moments import Polygon
from ..hull import convex_hull
from .kept import State, check_array
from .observer import ColumnObserver, NamedColumn
from .statistics import Statistics

Array = NDArray[np.float64]

EDGES = 24  # at most, of the polygon of some corners: with more of them fewer points lie between it and the hull
BATCH_ROWS = 10_000  # looked at together: most batches of a long run have no point outside of the hull
WIDER_ROWS = 500  # that lie outside of the hull wait for a new one: it costs as much as to look at 10000
MARGIN = 1e-6  # of the polygon's size: far more than rounding


@dataclass(frozen=True, eq=False)
class Scatter:
    """The image points of a run; radii are about their mean, in the unit of the columns."""

    unit: str
    count: int
    centre: Array  # (2,) mean
    radius_rms: float
    radius_max: float
    radius_50: float  # half of the points are closer than this; from ``points``
    radius_95: float
    hull: Array  # (n, 2) corners of the convex hull, counter-clockwise
    hull_area: float
    points: Array  # (n, 2) evenly thinned sample of the points, for figures


class ScatterObserver(ColumnObserver):
    """Centre, radii and convex hull of the points in two columns (``plant.los.x``, ``plant.los.y``).

    Mean, RMS and greatest radius and the hull are exact; the 50 % and 95 % radii come from an evenly thinned
    sample of ``sample`` to ``2 * sample`` points.
    """

    def __init__(
        self,
        columns: Sequence[NamedColumn],
        names: Sequence[str],
        *,
        sample: int = 5000,
        start_s: float = -math.inf,
    ) -> None:
        super().__init__(columns, names, start_s=start_s)
        if len(self.names) != 2:
            raise ValueError(f"names: expected the two coordinates of the image point, got {len(self.names)}")
        if self.units[0] != self.units[1]:
            raise ValueError(f"the coordinates differ in unit: {self.units[0]} and {self.units[1]}")
        if sample < 1:
            raise ValueError(f"sample: expected 1 or more, got {sample}")
        self._statistics = Statistics(columns, names)
        self._hull = _Hull(np.empty((0, 2)))
        self._sample = sample
        self._stride = 1
        self._rows = 0
        self._points = np.empty((0, 2))
        self._wider = np.empty((0, 2))
        self._held = np.empty((2, BATCH_ROWS))
        self._filled = 0

    KEPT = ("_stride", "_rows", "_points", "_wider")
    GROWING = ("_points", "_wider")

    def save_state(self) -> dict[str, Any]:
        """As :meth:`ColumnObserver.save_state`."""
        seen = {"hull": self._hull.corners, "statistics": self._statistics.save_state()}
        return {**super().save_state(), **seen, "held": self._held[:, : self._filled]}

    def load_state(self, state: State) -> None:
        """As :meth:`ColumnObserver.load_state`."""
        super().load_state(state)
        self._statistics.load_state(state["statistics"])
        self._hull = _Hull(check_array("hull", state["hull"], self._hull.corners, grows=True))
        held = check_array("held", state["held"].T, self._held.T, grows=True)
        if len(held) >= BATCH_ROWS:
            raise ValueError(f"held: expected less than {BATCH_ROWS} rows, found {len(held)}")
        self._filled = len(held)
        self._held[:, : self._filled] = held.T

    def take(self, time: Array, samples: Array) -> None:
        """Hold the rows; look at them when there is no room for more."""
        taken = 0
        while taken < samples.shape[1]:
            count = min(BATCH_ROWS - self._filled, samples.shape[1] - taken)
            self._held[:, self._filled : self._filled + count] = samples[:, taken : taken + count]
            taken += count
            self._filled += count
            if self._filled == BATCH_ROWS:
                self._evaluate()

    def _evaluate(self) -> None:
        """Widen the hull by the points that are held, and keep each ``stride``-th of them."""
        samples, self._filled = self._held[:, : self._filled], 0
        self._statistics.take(np.empty(0), samples)
        points = samples.T
        self._wider = np.concatenate((self._wider, points[self._hull.find_outside(samples)]))
        if len(self._wider) > WIDER_ROWS:
            self._widen()
        kept = points[-self._rows % self._stride :: self._stride]
        self._rows += len(points)
        self._points = np.concatenate((self._points, kept))
        while len(self._points) > 2 * self._sample:
            self._points = self._points[::2].copy()
            self._stride *= 2

    def _widen(self) -> None:
        """The hull, with the points that lay outside of it."""
        if len(self._wider):
            self._hull = _Hull(convex_hull(np.concatenate((self._hull.corners, self._wider))))
            self._wider = np.empty((0, 2))

    def result(self) -> Scatter:
        """The scatter so far; raises ``ValueError`` if no row has been seen."""
        if self._filled:
            self._evaluate()
        self._widen()
        statistics = self._statistics.result()
        centre = statistics.mean
        radius = np.hypot(*(self._points - centre).T)
        hull = self._hull.corners
        x, y = (hull - centre).T
        return Scatter(
            unit=self.units[0],
            count=statistics.count,
            centre=centre,
            radius_rms=float(np.hypot(*statistics.std)),
            # The point farthest from any given one is a corner of the hull.
            radius_max=float(np.hypot(x, y).max()),
            radius_50=float(np.quantile(radius, 0.50)),
            radius_95=float(np.quantile(radius, 0.95)),
            hull=hull.copy(),
            hull_area=0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))),
            points=self._points.copy(),
        )


class _Hull:
    """Counter-clockwise corners (n, 2) of a hull that is asked which points lie outside.

    Few do, and this costs a fraction of a new hull (3 instead of 60 ns per point, in blocks of 10000) however many
    corners there are: 60 of the shape that noise makes, 500 of a slow motion.
    """

    def __init__(self, corners: Array) -> None:
        self.corners = corners
        self._inner: Polygon | None = None
        self._outer: Polygon | None = None
        if len(corners) < 3:
            return
        inside = corners.mean(axis=0)
        ends = corners - inside
        self._inner, self._outer = (
            None if normals is None else Polygon(inside, normals)
            for normals in (_find_normals(ends[:: -(-len(ends) // EDGES)]), _find_normals(ends))
        )

    def find_outside(self, points: Array) -> NDArray[np.intp]:
        """Places of those of the points (2, m) that lie outside, and of some that hardly lie inside.

        Of all points where the hull is as thin as rounding.
        """
        if self._outer is None:
            return np.arange(points.shape[1])
        if self._inner is None:
            return self._outer.find_outside(points)
        far = self._inner.find_outside(points)
        return far[self._outer.find_outside(points[:, far])] if len(far) else far


def _find_normals(corners: Array) -> Array | None:
    """Normals (n, 2), as of :class:`.Polygon`, of a polygon of corners (n, 2) about a point inside, a little smaller.

    None if the point lies outside of it, or on an edge to rounding.  Of the points of a run all but a few lie inside,
    and need not be looked at closer.
    """
    edges = np.roll(corners, -1, axis=0) - corners
    normals = np.stack([edges[:, 1], -edges[:, 0]], axis=1)
    heights = (normals * corners).sum(axis=1)
    size = float(np.abs(corners).max())
    if not (heights > MARGIN * size * np.hypot(edges[:, 0], edges[:, 1])).all():
        return None
    return np.asarray(normals / (heights[:, None] * (1.0 - MARGIN)))
