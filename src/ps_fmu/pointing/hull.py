"""Convex hull of image points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

#: Twice the area of a triangle, for points that span one, that is rounding.
_FLAT = 1e-14


def convex_hull(points: Array) -> Array:
    """Corners (n, 2) of the convex hull of ``points`` (m, 2), counter-clockwise.

    Points on one line (or all the same) have no area: then the two ends (or the one point) are returned.

    A. M. Andrew, Inf. Process. Lett. 9(5), 1979: lower and upper chain of the sorted points, in 1 us for each point.
    ``scipy.spatial`` needs 0.2 us, and 0.3 s to be imported: more than a run of 100 s saves by it.
    """
    points = np.unique(points, axis=0)
    if len(points) < 3:
        return points
    # Image points are micrometres.
    scaled = (points - points.mean(axis=0)) / np.ptp(points, axis=0).max()
    x, y = scaled.T.tolist()
    lower = _walk(range(len(x)), x, y)
    upper = _walk(range(len(x) - 1, -1, -1), x, y)
    corners = lower[:-1] + upper[:-1]
    if len(corners) < 3:  # the sorted ends are those of the line
        return points[[0, -1]]
    return points[corners]


def _walk(order: range, x: list[float], y: list[float]) -> list[int]:
    """The corners of the chain, in this order, that turns left at each."""
    chain: list[int] = []
    for new in order:
        while len(chain) > 1:
            a, b = chain[-2:]
            if (x[b] - x[a]) * (y[new] - y[a]) - (y[b] - y[a]) * (x[new] - x[a]) > _FLAT:
                break
            chain.pop()
        chain.append(new)
    return chain
