"""Convex hull of image points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Twice the area of a triangle, for points that span one, that is rounding.
_FLAT = 1e-14
#: In each direction, and in the opposite one, is an extreme point, and what lies inside of these is no corner.  First
#: few directions for many points, then more for those that are left: of 10000 points of a run 100.
_DIRECTIONS = [
    np.stack([np.cos(np.pi * np.arange(n) / n), np.sin(np.pi * np.arange(n) / n)], axis=1) for n in (4, 16)
]
#: How far inside, in the size of the points: far more than rounding.
_MARGIN = 1e-9


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
