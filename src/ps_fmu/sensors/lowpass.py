"""The bandwidth of a sensor: a low-pass of first or second order, discretised exactly for an input held over a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..mechanism.quantities import Array, Complex

DAMPING = float(np.sqrt(0.5))  # of the second order: Butterworth, -3 dB at the bandwidth


@dataclass(frozen=True)
class SensorLowpass:
    """``x' = A x + b u``, ``y = x_1``, static gain one; x has two components, of which the first order needs one."""

    bandwidth: float
    """At which the gain is -3 dB, Hz; 0: none, the output is the input."""
    order: int
    """1 or 2."""

    def discretise(self, h: float) -> tuple[Array, Array]:
        """(2, 2) and (2,): ``x(t + h) = Ad x(t) + bd u`` with u held over a step of ``h``, s.

        In closed form, so that an FMU needs no scipy.  Without bandwidth x_1 is the input.
        """
        if not self.bandwidth:
            return np.zeros((2, 2)), np.array([1.0, 0.0])
        omega = 2.0 * np.pi * self.bandwidth
        if self.order == 1:
            decay = float(np.exp(-omega * h))
            return np.array([[decay, 0.0], [0.0, 0.0]]), np.array([1.0 - decay, 0.0])
        damped, decay = omega * np.sqrt(1.0 - DAMPING**2), float(np.exp(-DAMPING * omega * h))
        cosine, sine = np.cos(damped * h), np.sin(damped * h) * omega / damped
        # States: the output and its rate over omega, so that both have the size of the input.
        Ad = decay * np.array([[cosine + DAMPING * sine, sine], [-sine, cosine - DAMPING * sine]])
        return Ad, np.array([1.0 - Ad[0, 0], -Ad[1, 0]])

    def response(self, s: Complex) -> Complex:
        """Gain at complex frequencies (...), rad/s, in continuous time."""
        s = np.asarray(s, dtype=complex)
        if not self.bandwidth:
            return np.ones_like(s)
        p = s / (2.0 * np.pi * self.bandwidth)
        return 1.0 / (p + 1.0) if self.order == 1 else 1.0 / (p * p + 2.0 * DAMPING * p + 1.0)

    def sampled_response(self, frequency: Array, h: float) -> Complex:
        """Gain at frequencies (n,), Hz, from an input held over steps of ``h``, s, to the output at their ends.

        A step later than the input: it holds the delay of an exchange once in a step.
        """
        Ad, bd = self.discretise(h)
        z = np.exp(2j * np.pi * np.asarray(frequency) * h)
        return np.asarray(np.linalg.solve(z[:, None, None] * np.eye(2) - Ad, bd[:, None].astype(complex))[:, 0, 0])
