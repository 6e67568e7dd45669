"""What accelerometers at places on the bus see, and the motion that follows from their readings by least squares.

A sensor k at r_k along the unit vector n_k, all in B, reads ``n_k . (a_B + alpha x r_k + w x (w x r_k))``.
"""

from __future__ import annotations

import numpy as np

from ..mechanism.quantities import Array, ParameterError

#: Largest condition number of the geometry, lengths over the mean lever arm; beyond it noise is magnified as much.
LARGEST_CONDITION = 1e3
#: Products of the angular velocity, in the order of the columns of :func:`centripetal_rows`.
PRODUCTS = ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2))


def geometry_rows(position_B: Array, direction_B: Array) -> Array:
    """(n, 6): from acceleration of the origin of B (m/s2) and angular acceleration (rad/s2), in B, to readings.

    ``n . (alpha x r) = alpha . (r x n)``.  Both arguments (n, 3), m and unit vectors.
    """
    return np.hstack([direction_B, np.cross(position_B, direction_B)])


def centripetal_rows(position_B: Array, direction_B: Array) -> Array:
    """(n, 6): from the products w_i w_j of :data:`PRODUCTS` (rad2/s2; B) to readings, m/s2.

    ``n . (w x (w x r)) = (n . w)(w . r) - (n . r)(w . w)``.
    """
    n, r = direction_B, position_B
    rows = [
        n[:, i] * r[:, j] + (n[:, j] * r[:, i] if i != j else -np.einsum("ki,ki->k", n, r)) for i, j in PRODUCTS
    ]
    return np.stack(rows, axis=1)


def estimator(position_B: Array, direction_B: Array) -> Array:
    """(6, n): from readings to acceleration and angular acceleration of B by least squares, for equal sensors.

    Raises
    ------
    ParameterError: the sensors cannot see six degrees of freedom; the text has the motion that they do not see.
    """
    rows = geometry_rows(position_B, direction_B)
    arm = float(np.sqrt(np.mean(np.sum(position_B**2, axis=1)))) if len(rows) else 0.0
    scale = np.repeat([1.0, arm or 1.0], 3)
    scaled = rows / scale
    values, motions = np.linalg.svd(scaled)[1:] if len(rows) else (np.zeros(0), np.eye(6))
    if len(values) < 6 or values[-1] * LARGEST_CONDITION < values[0]:
        raise ParameterError("accelerometers", _explain(len(rows), motions[-1] / scale))
    return np.asarray(np.linalg.pinv(scaled) / scale[:, None])


def _explain(count: int, motion: Array) -> str:
    motion = motion / np.abs(motion).max()
    texts = [", ".join(f"{value + 0.0:.2g}" for value in np.round(part, 3)) for part in (motion[:3], motion[3:])]
    return (
        f"the {count} that are enabled cannot see six degrees of freedom: none reads an acceleration of "
        f"({texts[0]}) m/s2 with an angular acceleration of ({texts[1]}) rad/s2; expected places and directions that "
        "see every motion, for example three axes at each of three places that are not on a line"
    )
