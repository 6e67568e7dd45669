"""What the FMUs make of a line of the disturbance, in closed form and exact for the communication step.

At z = exp(j 2 pi f h) the plant and the isolator, as their FMUs step them, are matrices; over a step each holds what
the others put out at its start (Jacobi).  With S the step map ``[y; x](t + h) = S [x; u](t)``::

    x = (z - S_xx)^-1 S_xu u,    y = (S_yx x + S_yu u) / z

    a = P_af f + P_aw w,    f = K z^-d a,    theta = P_tf f + P_tw w        d: delay of the isolator in steps

There is no limit on f h: a line that the steps fold is where it is folded to.  The orientation is constant, and the
platform's motion so small that the plant keeps its linear model.
"""

from __future__ import annotations

import numpy as np

from ..control.feedforward import Controller
from ..mechanism.linear_model import PlantModel
from ..mechanism.quantities import Array, Complex
from ..mechanism.signals import output_slices

FORCES, WRENCH = slice(0, 3), slice(3, 9)  # of the plant's inputs
_BLOCK = 64  # frequencies at once: 5 MB for the plant's 49 states


def from_wrench_stepped(
    model: PlantModel, controller: Controller | None, frequency: Array, h: float, *, delay: float = 0.0
) -> Complex:
    """Wrench on the base (N, N.m; B at its origin) to payload rotation (rad; P) at the instants, (n, 3, 6).

    Parameters
    ----------
    model: the plant about rest.
    controller: of the isolator; None: it is off.
    frequency: (n,), Hz; not 0, and no multiple of the rate of the steps.
    h: communication step, s.
    delay: of the isolator's forces, s, a multiple of the step.
    """
    y = output_slices()
    rotation, acceleration = y["payload_rotation"], slice(0, y["base_angular_acceleration"].stop)
    z = np.exp(2j * np.pi * h * np.asarray(frequency, dtype=float))
    P = respond(model.step_map(h), model.n_states, z)
    to_rotation = P[:, rotation, WRENCH]
    if controller is None:
        return np.asarray(to_rotation)
    K = respond(controller.step_map(h), controller.n_states, z) * (z ** -round(delay / h))[:, None, None]
    loop = np.eye(3) - K @ P[:, acceleration, FORCES]
    force = np.linalg.solve(loop, K @ P[:, acceleration, WRENCH])
    return np.asarray(to_rotation + P[:, rotation, FORCES] @ force)


def respond(step: Array, n_states: int, z: Complex) -> Complex:
    """Outputs per input (n, outputs, inputs) at z (n,) of a step map ``[y; x](t + h) = step [x; u](t)``."""
    n_outputs = len(step) - n_states
    S_yx, S_yu = np.split(step[:n_outputs], [n_states], axis=1)
    S_xx, S_xu = np.split(step[n_outputs:], [n_states], axis=1)
    found = np.empty((len(z), n_outputs, S_yu.shape[1]), dtype=complex)
    for first in range(0, len(z), _BLOCK):
        at = z[first : first + _BLOCK, None, None]
        states = np.linalg.solve(at * np.eye(n_states) - S_xx, S_xu.astype(complex))
        found[first : first + _BLOCK] = (S_yx @ states + S_yu) / at
    return found
