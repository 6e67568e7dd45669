"""Scatter of the image point: where the line of sight falls on the image plane during a run."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .observer import Buffer, ColumnObserver, NamedColumn
from .statistics import Statistics

Array = NDArray[np.float64]

BATCH_ROWS = 10_000  # looked at together: each look costs as much as some 3000 rows
#: Twice the area of a triangle, for points that span one, that is rounding.
_FLAT = 1e-14
#: In each direction, and in the opposite one, is an extreme point, and what lies inside of these is no corner.  First
#: few directions for many points, then more for those that are left: of 10000 points of a run 100.
_DIRECTIONS = [
    np.stack([np.cos(np.pi * np.arange(n) / n), np.sin(np.pi * np.arange(n) / n)], axis=1) for n in (4, 16)
]
#: How far inside, in the size of the points: far more than rounding.
_MARGIN = 1e-9


@dataclass(frozen=True, eq=False)
class Scatter:
    """The image points of a run; radii are about their mean, in the unit of the columns."""

    unit: str
    count: int
    centre: Array  # (2,) mean
    radius_rms: float
    radius_max: float
    hull: Array  # (n, 2) corners of the convex hull, counter-clockwise
    hull_area: float
    points: Array  # (n, 2) evenly thinned sample of the points, for figures


class ScatterObserver(ColumnObserver):
    """Centre, radii and convex hull of the points in two columns (``plant.los.x``, ``plant.los.y``).

    Mean, RMS and greatest radius and the hull are exact; for figures ``sample`` to ``2 * sample`` of the points are
    kept, evenly thinned.
    """

    KEPT = ("_stride", "_rows", "_points", "_hull", "_statistics", "_buffer")
    GROWING = ("_points", "_hull")

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
        self._sample = sample
        self._stride = 1
        self._rows = 0
        self._points = np.empty((0, 2))
        self._buffer = Buffer(2, BATCH_ROWS)

    def take(self, time: Array, samples: Array) -> None:
        """Hold the rows; look at them when there is no room for more."""
        for held in self._buffer.add(samples):
            self._evaluate(held)

    def _evaluate(self, samples: Array) -> None:
        """Widen the hull by the points that are held, and keep each ``stride``-th of them."""
        self._buffer.filled = 0
        self._statistics.take(np.empty(0), samples)
        points = samples.T
        self._hull = convex_hull(np.concatenate((self._hull, points)))
        kept = points[-self._rows % self._stride :: self._stride]
        self._rows += len(points)
        self._points = np.concatenate((self._points, kept))
        while len(self._points) > 2 * self._sample:
            self._points = self._points[::2].copy()
            self._stride *= 2

    def result(self) -> Scatter:
        """The scatter so far; raises ``ValueError`` if no row has been seen."""
        self.take_held()
        if self._buffer.filled:
            self._evaluate(self._buffer.held)
        statistics = self._statistics.result()
        centre = statistics.mean
        hull = self._hull
        x, y = (hull - centre).T
        return Scatter(
            unit=self.units[0],
            count=statistics.count,
            centre=centre,
            radius_rms=float(np.hypot(*statistics.std)),
            # The point farthest from any given one is a corner of the hull.
            radius_max=float(np.hypot(x, y).max()),
            hull=hull.copy(),
            hull_area=0.5 * abs(float(x @ np.roll(y, -1) - y @ np.roll(x, -1))),
            points=self._points.copy(),
        )


def convex_hull(points: Array) -> Array:
    """Corners (n, 2) of the convex hull of ``points`` (m, 2), counter-clockwise.

    Points on one line (or all the same) have no area: then the two ends (or the one point) are returned.

    A. M. Andrew, Inf. Process. Lett. 9(5), 1979: lower and upper chain of the sorted points.  ``scipy.spatial`` needs
    0.2 us for each point, and 0.3 s to be imported: more than a run of 100 s saves by it.
    """
    centred = points - points[:1]  # exact for jitter beside an offset, whose rounding would hide what lies outside
    for directions in _DIRECTIONS:
        outer = _find_outer(centred, directions)
        points, centred = points[outer], centred[outer]
    points = points[np.lexsort((points[:, 1], points[:, 0]))]
    new = np.ones(len(points), dtype=bool)
    new[1:] = (points[1:] != points[:-1]).any(axis=1)
    points = points[new]
    if len(points) < 3:
        return points
    # Image points are micrometres.
    scaled = np.ascontiguousarray(((points - points.mean(axis=0)) / np.ptp(points, axis=0).max()).T)
    places = np.arange(len(points))
    lower, upper = _walk(places, scaled), _walk(places[::-1], scaled[:, ::-1])
    corners = lower[:-1] + upper[:-1]
    if len(corners) < 3:  # the sorted ends are those of the line
        return points[[0, -1]]
    return points[corners]


def _find_outer(points: Array, directions: Array) -> NDArray[np.bool_]:
    """Which of the points (m, 2) do not lie inside the polygon of the extreme ones in the directions (n, 2)."""
    heights = directions @ points.T
    extreme = points[np.concatenate((heights.argmax(axis=1), heights.argmin(axis=1)))]
    edges = np.roll(extreme, -1, axis=0) - extreme  # counter-clockwise, as the directions are
    edges = edges[edges.any(axis=1)]
    starts = extreme[(np.roll(extreme, -1, axis=0) != extreme).any(axis=1)]
    if len(starts) < 3:
        return np.ones(len(points), dtype=bool)
    outward = np.stack([edges[:, 1], -edges[:, 0]], axis=1) / np.hypot(edges[:, 0], edges[:, 1])[:, None]
    beyond = outward @ points.T
    beyond -= (outward * starts).sum(axis=1)[:, None]  # in place: of many points these are large arrays
    return np.asarray(beyond.max(axis=0) > -_MARGIN * np.ptp(extreme, axis=0).max())


def _walk(places: NDArray[np.intp], points: Array) -> list[int]:
    """Those of the places that are corners of the chain, in this order, that turns left at each."""
    chain: list[int] = []
    x: list[float] = []
    y: list[float] = []
    for place, x_new, y_new in zip(places.tolist(), *points.tolist(), strict=True):
        while len(chain) > 1:
            x_last, y_last = x[-2], y[-2]
            if (x[-1] - x_last) * (y_new - y_last) - (y[-1] - y_last) * (x_new - x_last) > _FLAT:
                break
            del chain[-1], x[-1], y[-1]
        chain.append(place)
        x.append(x_new)
        y.append(y_new)
    return chain
