"""Transfer matrices of the nominal model and of the practical plant.

Every function takes complex frequencies ``s`` of any shape (...,) in rad/s and returns matrices of shape
(..., rows, columns).  Inputs are the fine forces f_f (3, N) and the base wrench w_b (6; N, N.m; B axes, at the
origin of B), outputs the payload rotation theta_p (3, rad, B axes) and the base motion q_b (6; m, rad).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..mechanism.dynamics import Dynamics
from ..mechanism.quantities import Array, Complex

_BASE = np.arange(6)  # base motion, first of the coordinates that are free when the fine legs are held


@dataclass(frozen=True, eq=False)
class Nominal:
    """The paper's nominal model: rigid legs and payload, bus modes without damping (eqs 26-46, signs corrected)."""

    dynamics: Dynamics

    def U(self, s: ArrayLike) -> tuple[Complex, Complex, Complex, Complex]:
        """U11 (3, 3), U12 (3, 6), U21 (6, 3), U22 (6, 6) of eq (30), with minus on the modal term."""
        d, places = self.dynamics, self.dynamics.slices
        d_f, q_b = places["d_f"], places["q_b"]
        s = _column(s)
        s2 = s * s
        U11 = s2 * d.M[d_f, d_f] + s * d.C[d_f, d_f] + d.K[d_f, d_f]
        U12 = s2 * d.M[d_f, q_b]
        U22 = s2 * d.M[q_b, q_b] - s2 * self._modal_mass(s)
        return U11, U12, np.swapaxes(U12, -1, -2), U22

    def _modal_mass(self, s: Complex) -> Complex:
        """M_b12 (s^2 M_b22 + K_bm)^-1 s^2 M_b21, (..., 6, 6): Q of eq (56)."""
        d = self.dynamics
        x_m, q_b = d.slices["x_m"], d.slices["q_b"]
        on = d.active[x_m]
        M_b12 = d.M[q_b, x_m][:, on]
        M_b22, K_bm = np.diag(d.M[x_m, x_m])[on], np.diag(d.K[x_m, x_m])[on]
        s2 = s * s
        return np.asarray(((M_b12 * (s2 / (s2 * M_b22 + K_bm))) @ M_b12.T).astype(complex))

    def G_P(self, s: ArrayLike) -> Complex:
        """Passive transmissibility base motion -> payload rotation (3, 6), eq (38); immune to the bus modes."""
        U11, U12, _, _ = self.U(s)
        J = self.dynamics.jacobians
        return np.asarray(J.J_theta_b - J.J_theta_f @ np.linalg.solve(U11, U12))

    def D(self, s: ArrayLike) -> Complex:
        """Base wrench -> base motion (6, 6), eq (33)."""
        U11, U12, U21, U22 = self.U(s)
        return np.asarray(np.linalg.inv(U22 - U21 @ np.linalg.solve(U11, U12)))

    def C(self, s: ArrayLike) -> Complex:
        """Fine force -> base motion (6, 3), eq (34): the mobile-base effect."""
        U11, _, U21, _ = self.U(s)
        return np.asarray(-self.D(s) @ U21 @ np.linalg.inv(U11))

    def G11(self, s: ArrayLike) -> Complex:
        """Fine force -> fine elongation (3, 3), eq (31)."""
        U11, U12, U21, U22 = self.U(s)
        return np.asarray(np.linalg.inv(U11 - U12 @ np.linalg.solve(U22, U21)))

    def A(self, s: ArrayLike) -> Complex:
        """Fine force -> payload rotation (3, 3), eq (36)."""
        J = self.dynamics.jacobians
        return np.asarray(J.J_theta_f @ self.G11(s) + J.J_theta_b @ self.C(s))

    def B(self, s: ArrayLike) -> Complex:
        """Base wrench -> payload rotation (3, 6), eq (35)."""
        return np.asarray(self.G_P(s) @ self.D(s))

    def Y(self, s: ArrayLike) -> Complex:
        """U22^-1 U21 (6, 3) of eqs (41), (43), (44): minus the base motion per fine elongation.

        Without modal damping it is infinite at the free modes of the bus; its supremum is a matter for
        :meth:`Practical.mobile_base_factor`.
        """
        _, _, U21, U22 = self.U(s)
        return np.asarray(np.linalg.solve(U22, U21))

    def mobile_base_estimate(self) -> float:
        """Estimate (42) of the mobile-base factor; it ignores the resonances of the bus modes."""
        d = self.dynamics
        d_f, q_b = d.slices["d_f"], d.slices["q_b"]
        return float(np.linalg.svd(np.linalg.solve(d.M[q_b, q_b], d.M[q_b, d_f]), compute_uv=False)[0])


@dataclass(frozen=True, eq=False)
class Practical:
    """The practical plant: every active group of coordinates, with its damping."""

    dynamics: Dynamics

    def _response(self, s: ArrayLike, force: Array) -> Complex:
        """(..., n_active, k): coordinates from generalised forces (n, k)."""
        d = self.dynamics
        on = np.flatnonzero(d.active)
        pick = np.ix_(on, on)
        s = _column(s)
        return np.asarray(np.linalg.solve(s * s * d.M[pick] + s * d.C[pick] + d.K[pick], force[on].astype(complex)))

    def _outputs(self) -> tuple[Array, Array]:
        d = self.dynamics
        base = np.zeros((6, d.n))
        base[:, d.slices["q_b"]] = np.eye(6)
        return d.platform_rows()[3:, d.active], base[:, d.active]

    def all(self, s: ArrayLike) -> tuple[Complex, Complex, Complex, Complex]:
        """A, B, C and D, as the methods of these names, by one solve."""
        force = np.hstack([_unit(self.dynamics, "d_f"), _unit(self.dynamics, "q_b")])
        response = self._response(s, force)
        payload, base = (output @ response for output in self._outputs())
        return payload[..., :3], payload[..., 3:], base[..., :3], base[..., 3:]

    def A(self, s: ArrayLike) -> Complex:
        """Fine force -> payload rotation (3, 3)."""
        return np.asarray(self._outputs()[0] @ self._response(s, _unit(self.dynamics, "d_f")))

    def B(self, s: ArrayLike) -> Complex:
        """Base wrench -> payload rotation (3, 6)."""
        return np.asarray(self._outputs()[0] @ self._response(s, _unit(self.dynamics, "q_b")))

    def C(self, s: ArrayLike) -> Complex:
        """Fine force -> base motion (6, 3)."""
        return np.asarray(self._outputs()[1] @ self._response(s, _unit(self.dynamics, "d_f")))

    def D(self, s: ArrayLike) -> Complex:
        """Base wrench -> base motion (6, 6)."""
        return np.asarray(self._outputs()[1] @ self._response(s, _unit(self.dynamics, "q_b")))

    def G_P(self, s: ArrayLike) -> Complex:
        """Passive transmissibility B D^-1 (3, 6), eq (37)."""
        return np.asarray(self.B(s) @ np.linalg.inv(self.D(s)))

    def Y(self, s: ArrayLike) -> Complex:
        """Minus the base motion per fine elongation (6, 3), all else following: U22^-1 U21 of eq (41), with damping."""
        d = self.dynamics
        d_f, others = self._held_and_free()
        s = _column(s)
        free = np.ix_(others, others)
        stiffness = s * s * d.M[free] + s * d.C[free] + d.K[free]
        return np.asarray(np.linalg.solve(stiffness, s * s * d.M[others, d_f]))[..., : len(_BASE), :]

    def mobile_base_factor(self) -> float:
        """v of eq (41): the largest singular value of Y over all frequencies, to 1e-6; infinite without modal damping.

        With rigid legs and payload this is the paper's nominal system.  Its estimate (42) ignores the resonances:
        0.0144 against 0.041 for the original support module, 0.125 against 2.04 for the lighter one.
        """
        from control import ss, system_norm  # 1 s to import, and the plant FMU needs none of it

        # From d_f'' to -q_b'': neither spring nor damper acts on q_b, so that the states are the flexible ones alone.
        d = self.dynamics
        d_f, others = self._held_and_free()
        mobility = np.linalg.inv(d.M[np.ix_(others, others)])
        drive = mobility @ d.M[others, d_f]
        flexible = np.arange(len(_BASE), len(others))
        K, C = np.diag(d.K)[others][flexible], np.diag(d.C)[others][flexible]
        force = np.hstack([mobility[:, flexible] * K, mobility[:, flexible] * C])  # (others, 2 flexible)
        n = len(flexible)
        A = np.block([[np.zeros((n, n)), np.eye(n)], [-force[flexible]]])
        B = np.vstack([np.zeros((n, 3)), -drive[flexible]])
        # Square, by inputs without effect: python-control 0.10's norm takes nothing else.
        B, D = (np.hstack([matrix, np.zeros_like(matrix)]) for matrix in (B, drive[_BASE]))
        system = ss(A, B, force[_BASE], D)
        return float(system_norm(system, p="inf", print_warning=False))

    def _held_and_free(self) -> tuple[slice, NDArray[np.intp]]:
        """Place of the fine elongations, and the other active coordinates, the base first."""
        d = self.dynamics
        d_f = d.slices["d_f"]
        return d_f, np.flatnonzero(d.active)[d_f.stop :]


def place_frequencies(poles: Complex, low: float, high: float, points: int = 6000, per_pole: int = 60) -> Array:
    """Frequencies, Hz, logarithmic from low to high, and more of them around poles (n,), rad/s, by their damping."""
    poles = poles[poles.imag > 0.0] / (2.0 * np.pi)  # Hz
    spread = np.sinh(np.linspace(-6.0, 6.0, per_pole))
    around = (poles.imag[:, None] - poles.real[:, None] * spread).reshape(-1)
    grid = np.concatenate([np.geomspace(low, high, points), around[(around > low) & (around < high)]])
    return np.unique(grid)


def _column(s: ArrayLike) -> Complex:
    """``s`` with two trailing axes, so that it broadcasts against matrices."""
    return np.asarray(s, dtype=complex)[..., None, None]


def _unit(dynamics: Dynamics, group: str) -> Array:
    """(n, k) generalised force: one unit on each coordinate of a group."""
    place = dynamics.slices[group]
    force = np.zeros((dynamics.n, place.stop - place.start))
    force[place] = np.eye(place.stop - place.start)
    return force
