"""Convex hull of image points."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def convex_hull(points: Array) -> Array:
    """Corners (n, 2) of the convex hull of ``points`` (m, 2), counter-clockwise.

    Points on one line (or all the same) have no area: then the two ends (or the one point) are returned.
    """
    from scipy.spatial import ConvexHull, QhullError

    points = np.unique(points, axis=0)
    if len(points) < 3:
        return points
    offset = points.mean(axis=0)
    span = np.ptp(points, axis=0).max()
    # Qhull's tolerances suit coordinates of order one; image points are micrometres.
    scaled = (points - offset) / span
    try:
        return points[ConvexHull(scaled).vertices]
    except QhullError:
        along = scaled @ np.linalg.svd(scaled, full_matrices=False)[2][0]
        return points[[int(along.argmin()), int(along.argmax())]]
