"""A line-of-sight loop around a sampled system, at each frequency: what it makes of each part of a response.

With theta the rotation that the tracker sees, f the controller's forces, w all that acts from outside and n the noise::

    theta = G_w w + G_f f,    f = K (n - theta),    y = H_w w + H_f f
    f = K S (n - G_w w),      S = (E + G_f K)^-1

K has the controller as it steps, and what delays the loop.  y is linear in H, so that parts of H that add up to it, by
mode for example, give parts of the loop's answer that add up to that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..control.pointing import PointingFilter
from ..mechanism.quantities import Array, Complex
from .line_of_sight import Timing


@dataclass(frozen=True, eq=False)
class SampledPointing:
    """Tracker and controller.

    A tracker or controller that samples slower than the steps is replaced by its mean response, without images.
    """

    control: PointingFilter
    timing: Timing
    """Its step is that of communication, s, above 0."""
    roll_measured: bool = True
    """The rotation about the boresight is seen, too."""

    def response(self, frequency: Array) -> Complex:
        """K, from the rotation that is to be taken away (3, rad, P) to forces (3, N), (n, 3, 3), at frequencies, Hz."""
        t, h = self.timing, self.timing.step
        s: Complex = np.asarray(2j * np.pi * np.asarray(frequency))
        Ad, Bd = self.control.hold(h)
        # In increments: for slow errors the states of the two integrators change by little in a step.
        A, B = (Ad - np.eye(len(Ad))) / h, (Bd[:, :3] / h).astype(complex)
        point = np.expm1(s * h) / h
        K = self.control.output_map() @ np.linalg.solve(point[:, None, None] * np.eye(len(A)) - A, B)
        late = np.exp(-s * (t.latency + t.control_sample_time + t.control_delay))
        for time in (t.sample_time, t.control_sample_time):
            late = late * _held(np.asarray(s * h), max(round(time / h), 1))
        return np.asarray(K * late[:, None, None] * np.array([1.0, 1.0, float(self.roll_measured)]))


def close_loop(K: Complex, seen: Complex, answers: Complex, forces: slice) -> Complex:
    """Answers of the closed loop to what acts from outside and to the tracker's noise.

    Parameters
    ----------
    K: (n, 3, 3), see :meth:`SampledPointing.response`.
    seen: [G_w G_f] (n, 3, inputs), of the rotation that the tracker sees.
    answers: [H_w H_f] (..., n, signals, inputs), of any signals.
    forces: where the three inputs f are.

    Returns (..., n, signals, inputs): the columns of the forces are those of the noise n, rad.
    """
    G_f = seen[..., forces]
    demand = K @ np.linalg.inv(np.eye(3) + G_f @ K)  # K S
    from_outside = -demand @ seen
    from_outside[..., forces] = demand
    closed = np.asarray(answers[..., forces] @ from_outside)
    outside = np.ones(seen.shape[-1], dtype=bool)
    outside[forces] = False
    closed[..., outside] += answers[..., outside]
    return closed


def _held(x: Complex, every: int) -> Complex:
    """Mean of 1, exp(-x) ... exp(-(every - 1) x): a value that stays for so many steps."""
    return np.asarray(np.mean(np.exp(-x[:, None] * np.arange(every)), axis=1))
