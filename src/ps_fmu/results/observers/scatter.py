"""Scatter of the image point: where the line of sight falls on the image plane during a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ...pointing.hull import convex_hull
from .observer import ColumnObserver, NamedColumn
from .statistics import Statistics

Array = NDArray[np.float64]

MANY = 100
"""Points of which it is worth to leave some out before their hull is made: 1 us each."""
_ANGLES = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
_DIRECTIONS = np.array([np.cos(_ANGLES), np.sin(_ANGLES)])
FLAT = 1e-8  # determinant over squared trace below which the corners of a hull lie on a line, to rounding
MARGIN = 1e-6  # of the ellipse's size: far more than rounding



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
        self._hull = np.empty((0, 2))
        self._core = _Core(self._hull)
        self._sample = sample
        self._stride = 1
        self._rows = 0
        self._points = np.empty((0, 2))

    def take(self, time: Array, samples: Array) -> None:
        """Widen the hull by the block's points and keep each ``stride``-th of them."""
        self._statistics.take(time, samples)
        points = samples.T
        far = points[self._core.find_beyond(samples)]
        wider = far[_find_outside(self._hull, far)] if len(far) else far
        if len(wider):
            self._hull = convex_hull(_leave_out_inner(np.concatenate((self._hull, wider))))
            self._core = _Core(self._hull)
        kept = points[-self._rows % self._stride :: self._stride]
        self._rows += len(points)
        self._points = np.concatenate((self._points, kept))
        while len(self._points) > 2 * self._sample:
            self._points = self._points[::2].copy()
            self._stride *= 2

    def result(self) -> Scatter:
        """The scatter so far; raises ``ValueError`` if no row has been seen."""
        statistics = self._statistics.result()
        centre = statistics.mean
        radius = np.hypot(*(self._points - centre).T)
        x, y = (self._hull - centre).T
        return Scatter(
            unit=self.units[0],
            count=statistics.count,
            centre=centre,
            radius_rms=float(np.hypot(*statistics.std)),
            # The point farthest from any given one is a corner of the hull.
            radius_max=float(np.hypot(x, y).max()),
            radius_50=float(np.quantile(radius, 0.50)),
            radius_95=float(np.quantile(radius, 0.95)),
            hull=self._hull.copy(),
            hull_area=0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))),
            points=self._points.copy(),
        )


class _Core:
    """An ellipse inside a hull: of the points of a run all but a few lie in it, and need not be looked at closer.

    It has the axes of the hull's corners, and touches the nearest edge (0.03 instead of 0.2 us a point, in blocks of
    1000).
    """

    def __init__(self, hull: Array) -> None:
        self._rounds: Array | None = None
        if len(hull) < 3:
            return
        self._middle = hull.mean(axis=0)
        corners = hull - self._middle
        scatter = corners.T @ corners
        if not np.linalg.det(scatter) > FLAT * np.trace(scatter) ** 2:
            return
        rounds = np.linalg.inv(np.linalg.cholesky(scatter))
        x, y = rounds @ corners.T
        x_next, y_next = np.roll(x, -1), np.roll(y, -1)
        length = np.hypot(x_next - x, y_next - y)
        distance = ((x * y_next - y * x_next)[length > 0.0] / length[length > 0.0]).min()
        if distance > 0.0:
            self._rounds = rounds / (distance * (1.0 - MARGIN))  # of the ellipse it makes the unit circle

    def find_beyond(self, samples: Array) -> NDArray[np.intp]:
        """Places of the points (2, n) that lie outside the ellipse."""
        if self._rounds is None:
            return np.arange(samples.shape[1])
        x, y = samples[0] - self._middle[0], samples[1] - self._middle[1]
        (a, _), (b, c) = self._rounds
        x, y = a * x, b * x + c * y
        return np.flatnonzero(x * x + y * y > 1.0)


def _leave_out_inner(points: Array) -> Array:
    """Points (n, 2) without most of those inside their hull: inside the polygon of the outermost in 16 directions."""
    if len(points) < MANY:
        return points
    # Scaled: a motion may be far longer than wide.
    size = np.ptp(points, axis=0)
    outermost = np.unique((points / np.where(size > 0.0, size, 1.0) @ _DIRECTIONS).argmax(axis=0))
    polygon = convex_hull(points[outermost])
    if len(polygon) < 3:
        return points
    return np.concatenate((polygon, points[_find_outside(polygon, points)]))


def _find_outside(hull: Array, points: Array) -> NDArray[np.bool_]:
    """Which points lie outside a counter-clockwise hull: on the right of the edge in whose sector, seen from a point
    inside, they are.

    Few do, and this costs a fraction of a new hull (0.08 instead of 0.54 us per point, in blocks of 1000) however many
    corners there are: 60 of the shape that noise makes, 500 of a slow motion.
    """
    if len(hull) < 3:
        return np.ones(len(points), dtype=bool)
    inside = hull.mean(axis=0)
    ends = hull - inside
    angles = np.arctan2(ends[:, 1], ends[:, 0])
    first = int(angles.argmin())
    ends, angles = np.roll(ends, -first, axis=0), np.roll(angles, -first)
    starts = np.roll(ends, 1, axis=0)
    x, y = (points - inside).T
    edge = np.searchsorted(angles, np.arctan2(y, x)) % len(angles)
    (x_edge, y_edge), (x_start, y_start) = (ends - starts)[edge].T, starts[edge].T
    return np.asarray(x_edge * (y - y_start) < y_edge * (x - x_start))
