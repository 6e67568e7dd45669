"""Feedforward isolation: gains (52)-(54) and the practical controller (55).

The optimal force is ``f_f = K_a q_b'' + K_v q_b' + K_d q_b``.  As printed, (55) pairs the gains with the wrong
signals: (52) multiplies ACCELERATION and (54) DISPLACEMENT.  The practical controller measures acceleration alone::

    K_we(s) = M(s) K_a + H1(s) K_v + H2(s) K_d        acting on q_b''

    H2(s) = 1 / (s^2 + 2 zeta w s + w^2)     high-passed double integrator
    H1(s) = s / (s^2 + 2 zeta w s + w^2)     high-passed integrator
    M(s)                                     Chebyshev type II low-pass of odd order: no feedthrough

One pair (position, velocity) per base axis serves both H1 and H2.  M(s) acts on the three forces K_a q_b'', not on
the six accelerations, as second-order sections: one polynomial of ninth order loses all digits at 1e-4 s.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ..mechanism.discretisation import make_held_step_map, zero_order_hold
from ..mechanism.dynamics import Pose, find_fine_mass
from ..mechanism.kinematics import jacobians
from ..mechanism.parameters import FeedforwardFilters, Manipulator, Payload
from ..mechanism.quantities import Array, Complex


@dataclass(frozen=True, eq=False)
class Gains:
    """Static gains from base motion (B axes, origin of B) to fine forces, each (3, 6)."""

    acceleration: Array  # eq (52)
    velocity: Array  # eq (53)
    displacement: Array  # eq (54)

    def optimal(self, s: Complex) -> Complex:
        """K_wop(s) = s^2 K_a + s K_v + K_d of eqs (50), (51), from displacement to force, (..., 3, 6)."""
        s = np.asarray(s, dtype=complex)[..., None, None]
        return np.asarray(s * s * self.acceleration + s * self.velocity + self.displacement)


def gains(manipulator: Manipulator, payload: Payload, pose: Pose) -> Gains:
    """Eqs (52)-(54) at a pose, for the payload as the controller knows it (its inertia does not matter)."""
    J = jacobians(manipulator.geometry, pose.translation_B, pose.rotation_BP)
    follow = np.linalg.solve(J.J_theta_f, J.J_theta_b)  # fine elongation that undoes the base rotation
    by_legs, by_base = find_fine_mass(manipulator, payload, pose, J)
    return Gains(
        acceleration=by_base - by_legs @ follow,
        velocity=-np.array([[leg.damping] for leg in manipulator.fine_legs]) * follow,
        displacement=-np.array([[leg.stiffness] for leg in manipulator.fine_legs]) * follow,
    )


@dataclass(frozen=True, eq=False)
class Lowpass:
    """M(s) as a chain of sections: ``x' = A x + b u``, ``y = c x + d u``, static gain one."""

    A: Array  # (order, order)
    b: Array  # (order,)
    c: Array  # (order,)
    d: float

    @property
    def order(self) -> int:
        """Number of states."""
        return len(self.b)

    def response(self, s: Complex) -> Complex:
        """M(s), (...)."""
        s = np.asarray(s, dtype=complex)[..., None, None]
        states = np.linalg.solve(s * np.eye(self.order) - self.A, self.b[:, None].astype(complex))
        return np.asarray(states[..., 0] @ self.c + self.d)


def lowpass(filters: FeedforwardFilters) -> Lowpass:
    """The Chebyshev type II low-pass M(s) of the paper's section 4.2 in continuous time."""
    omega = 2.0 * np.pi * filters.lowpass_stop_frequency  # rad/s
    A, b, c, d = np.zeros((0, 0)), np.zeros(0), np.zeros(0), 1.0
    for section in design_chebyshev(filters.lowpass_order, filters.lowpass_stop_attenuation):
        A2, b2, c2, d2 = _section(section)
        A = np.block([[A, np.zeros((len(b), len(b2)))], [np.outer(b2, c), A2]])
        b, c, d = np.concatenate([b, b2 * d]), np.concatenate([d2 * c, c2]), d2 * d
    return Lowpass(A * omega, b * omega, c / (d + _static(A, b, c)), d / (d + _static(A, b, c)))


def design_chebyshev(order: int, attenuation: float) -> Array:
    """Chebyshev type II low-pass of odd order in continuous time, stop-band edge at 1 rad/s, static gain one.

    Poles and zeros in closed form (T. W. Parks and C. S. Burrus, Digital Filter Design, Wiley 1987): those of
    type I, inverted.  ``scipy.signal.cheby2`` has the same; to import it takes 1.5 s.

    Parameters
    ----------
    order: odd.
    attenuation: least one in the stop band, dB.

    Returns
    -------
    Array: sections (b0, b1, b2, a0, a1, a2) of (b0 s^2 + b1 s + b2) / (a0 s^2 + a1 s + a2), ((order + 1) / 2, 6): the
    real pole, then pairs of poles with those of zeros that are nearest, from the largest damping to the smallest.
    """
    width = np.arcsinh(np.sqrt(10.0 ** (0.1 * attenuation) - 1.0)) / order
    angles = np.pi / (2 * order) * np.arange(2, order, 2)  # of the pairs, from the real axis; rad
    poles = -1.0 / (np.sinh(width) * np.cos(angles) + 1j * np.cosh(width) * np.sin(angles))
    real = 1.0 / np.sinh(width)  # rad/s
    sections = np.zeros((len(poles) + 1, 6))
    sections[0, [2, 4, 5]] = real, 1.0, real
    sections[1:, 2] = np.abs(poles) ** 2
    sections[1:, 0] = sections[1:, 2] * np.sin(angles) ** 2  # zeros at 1 / sin(angle)
    sections[1:, 3:] = np.column_stack([np.ones(len(poles)), -2.0 * poles.real, np.abs(poles) ** 2])
    return sections


def _static(A: Array, b: Array, c: Array) -> float:
    return float(-c @ np.linalg.solve(A, b))


def _section(section: Array) -> tuple[Array, Array, Array, float]:
    """State space of (b0 s^2 + b1 s + b2) / (s^2 + a1 s + a2), or of the same with b0 = a0 = 0 (first order)."""
    b0, b1, b2, a0, a1, a2 = section
    if a0 == 0.0:
        direct = b1 / a1
        return np.array([[-a2 / a1]]), np.array([1.0]), np.array([b2 / a1 - direct * a2 / a1]), direct
    scale = np.sqrt(a2)  # x2 = x1' / scale, so that both states have the size of the input
    A = np.array([[0.0, scale], [-a2 / scale, -a1]])
    b = np.array([0.0, scale])
    c = np.array([(b2 - b0 * a2) / scale**2, (b1 - b0 * a1) / scale])
    return A, b, c, float(b0)


@dataclass(frozen=True, eq=False)
class Controller:
    """The practical controller (55) as a state-space system from base acceleration (6) to fine force (3).

    State ``x = [p (6), v (6), m (3 x order)]``: high-passed displacement and velocity of each base axis, low-pass
    states of each force.  A new pose changes the gains only; the states keep their meaning.
    """

    gains: Gains
    lowpass: Lowpass
    filters: FeedforwardFilters

    @property
    def n_states(self) -> int:
        """Size of ``x``."""
        return 12 + 3 * self.lowpass.order

    def matrices(self) -> tuple[Array, Array, Array, Array]:
        """A, B, C, D of ``x' = A x + B a``, ``f = C x + D a``."""
        A, B = _filters(self.lowpass, self.filters)
        return A, self._driven(B), *self._outputs()

    def output_map(self) -> Array:
        """[C D]: force from state and input at the same instant."""
        return np.hstack(self._outputs())

    def step_map(self, h: float) -> Array:
        """[f; x](t + h) from [x; a](t), see :func:`.discretisation.make_held_step_map`."""
        Ad, Bd = _held_filters(self.lowpass, self.filters, h)
        return make_held_step_map(Ad, self._driven(Bd), *self._outputs())

    def response(self, s: Complex) -> Complex:
        """K_we(s) from base acceleration to fine force, (..., 3, 6): that of :meth:`matrices`, filter by filter.

        One high-pass serves all axes and one low-pass all forces: at 6000 frequencies 10 ms, where a solve with all 39
        states takes 660 ms.
        """
        return self.combine(s, self.lowpass.response(s))

    def combine(self, s: Complex, lowpass: Complex) -> Complex:
        """As :meth:`response`, where M(s), (...), is known."""
        s = np.asarray(s, dtype=complex)
        omega = 2.0 * np.pi * self.filters.highpass_frequency
        highpass = 1.0 / (s * s + 2.0 * self.filters.highpass_damping_ratio * omega * s + omega**2)
        parts = ((highpass, self.gains.displacement), (s * highpass, self.gains.velocity),
                 (lowpass, self.gains.acceleration))  # fmt: skip
        return np.asarray(sum(filtered[..., None, None] * gain for filtered, gain in parts))

    def _driven(self, B: Array) -> Array:
        """What drives the filters, (n, 6): B of the filters with the forces made from the acceleration."""
        return np.asarray(B[:, :6] + B[:, 6:] @ self.gains.acceleration)

    def _outputs(self) -> tuple[Array, Array]:
        """C and D."""
        C, low = np.zeros((3, self.n_states)), self.lowpass
        C[:, :6], C[:, 6:12] = self.gains.displacement, self.gains.velocity
        for i in range(3):
            C[i, 12 + i * low.order : 12 + (i + 1) * low.order] = low.c
        return C, low.d * self.gains.acceleration


def _filters(lowpass: Lowpass, filters: FeedforwardFilters) -> tuple[Array, Array]:
    """A and B of ``x' = A x + B [q_b''; K_a q_b'']``, (n, n) and (n, 9): the part that no pose changes."""
    n, omega = 12 + 3 * lowpass.order, 2.0 * np.pi * filters.highpass_frequency
    A, B = np.zeros((n, n)), np.zeros((n, 9))
    p, v = slice(0, 6), slice(6, 12)
    A[p, v] = np.eye(6)
    A[v, p], A[v, v] = -(omega**2) * np.eye(6), -2.0 * filters.highpass_damping_ratio * omega * np.eye(6)
    B[v, :6] = np.eye(6)
    for i in range(3):
        m = slice(12 + i * lowpass.order, 12 + (i + 1) * lowpass.order)
        A[m, m], B[m, 6 + i] = lowpass.A, lowpass.b
    return A, B


@lru_cache(maxsize=8)
def _held_filters(lowpass: Lowpass, filters: FeedforwardFilters, h: float) -> tuple[Array, Array]:
    """The filters over a step of ``h`` (s) with the input held; read-only."""
    held = zero_order_hold(*_filters(lowpass, filters), h)
    for matrix in held:
        matrix.setflags(write=False)
    return held
