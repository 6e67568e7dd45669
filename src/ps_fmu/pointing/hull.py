"""Convex hull of image points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Twice the area of a triangle, for points that span one, that is rounding.
_FLAT = 1e-14
#: How often the points below a line between their neighbours are left out at once, before the others are visited one by
#: one: 0.14 us a step for the hulls of a run of 5 s, where 0 times take 0.28 us and 8 times 0.15 us.
_SWEEPS = 3


def convex_hull(points: Array) -> Array:
    """Corners (n, 2) of the convex hull of ``points`` (m, 2), counter-clockwise.

    Points on one line (or all the same) have no area: then the two ends (or the one point) are returned.

    A. M. Andrew, Inf. Process. Lett. 9(5), 1979: lower and upper chain of the sorted points.  ``scipy.spatial`` needs
    0.2 us for each point, and 0.3 s to be imported: more than a run of 100 s saves by it.
    """
    points = points[np.lexsort((points[:, 1], points[:, 0]))]
    new = np.ones(len(points), dtype=bool)
    new[1:] = (points[1:] != points[:-1]).any(axis=1)
    points = points[new]
    if len(points) < 3:
        return points
    # Image points are micrometres.
    scaled = np.ascontiguousarray(((points - points.mean(axis=0)) / np.ptp(points, axis=0).max()).T)
    places = np.arange(len(points))
    lower, upper = _walk(*_sweep(places, scaled)), _walk(*_sweep(places[::-1], scaled[:, ::-1]))
    corners = lower[:-1] + upper[:-1]
    if len(corners) < 3:  # the sorted ends are those of the line
        return points[[0, -1]]
    return points[corners]


def _sweep(places: NDArray[np.intp], points: Array) -> tuple[NDArray[np.intp], Array]:
    """Leave out points (2, m) where a chain through all of them turns right: they are no corners of the hull."""
    for _ in range(_SWEEPS):
        (x, y), (x_next, y_next) = points[:, 1:-1] - points[:, :-2], points[:, 2:] - points[:, :-2]
        kept = np.ones(len(places), dtype=bool)
        kept[1:-1] = x * y_next - y * x_next > -_FLAT
        places, points = places[kept], points[:, kept]
    return places, points


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
