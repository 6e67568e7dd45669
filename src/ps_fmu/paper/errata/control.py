"""Feedforward control and its stability: (50) to (60); claims about results: Tables 1 and 2, Fig 10."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...mechanism.dynamics import Dynamics
from ...mechanism.parameters import Array, load
from ...theory.small_gain import nominal_complement
from ...theory.transfer_matrices import Complex
from ..bus_cases import assemble_nominal
from ..figures.fig06 import CLAIMED_LIMIT, compute_reach
from ..figures.fig10.closed_form import judge
from ..published import published_numbers
from . import case
from .case import Erratum, relative_error


def optimal_controller() -> Erratum:
    """(50), fourth line."""
    nominal, plant, J, s = case.nominal(), case.plant(), case.dynamics().jacobians, case.S
    U11, U12, U21, _ = nominal.U(s)
    G_P, G22, inverse = plant.G_P(s), nominal.D(s), np.linalg.inv(U11)
    optimal = -np.linalg.solve(plant.A(s) - G_P @ plant.C(s), G_P)

    def fourth_line(G: Complex) -> Complex:
        bracket = nominal.G11(s) - inverse @ U12 @ G @ U21 @ inverse
        return np.asarray(-np.linalg.solve(J.J_theta_f @ bracket, G_P))

    return Erratum(
        "(50), line 4",
        "... (-G22^-1 U21 U11^-1) ...",
        "... (-G22 U21 U11^-1) ...; the last line is right",
        "first line of (50) with A, G_P and C by one solve of (25), against line 4 and the gains (52) to (54)",
        max(relative_error(fourth_line(G22), optimal), relative_error(case.optimal_gains().optimal(s), optimal)),
        relative_error(fourth_line(np.asarray(np.linalg.inv(G22))), optimal),
    )


def gains_and_signals() -> Erratum:
    """(51) to (55): which gain belongs to which signal."""
    plant, s = case.plant(), case.S
    right = case.optimal_gains()
    printed = replace(right, acceleration=right.displacement, displacement=right.acceleration)
    G_P, C = plant.G_P(s), plant.C(s)
    path = plant.A(s) - G_P @ C  # fine force to payload with the base motion given

    def left(K: Complex) -> float:
        return relative_error(-path @ K, G_P)

    return Erratum(
        "(51) to (54), (55)",
        "K_we = H2 K(52) + H1 K(53) + M K(54)",
        "K_we = M K(52) + H1 K(53) + H2 K(54), on acceleration: (52) is the gain of acceleration, (54) of displacement",
        "what is left of the transmissibility with ideal filters, against G_P, by one solve of (25)",
        left(right.optimal(s)),
        left(printed.optimal(s)),
    )


def sensitivity() -> Erratum:
    """(56), last line."""
    d, nominal, s = case.dynamics(), case.nominal(), case.S
    q_b, d_f = d.slices["q_b"], d.slices["d_f"]
    U11, U12, U21, U22 = nominal.U(s)  # U22 is s^2 (M_eb - Q)
    right = np.linalg.inv(U22 - U21 @ case.following_matrix()) @ (U22 - U21 @ np.linalg.solve(U11, U12))
    M_eb, M_ebf = d.M[q_b, q_b], d.M[q_b, d_f]
    fine_legs = (s * s)[:, None, None] * (M_ebf @ np.linalg.solve(U11, M_ebf.T + 0.0j))
    printed = np.linalg.inv(M_eb + M_ebf @ case.following_matrix()) @ (M_eb - fine_legs)
    S = np.linalg.inv(np.eye(6) - case.plant().C(s) @ case.optimal_gains().optimal(s))
    return Erratum(
        "(56), last line",
        "(M_eb + M_ebf J_thf^-1 J_thb)^-1 (M_eb - s^2 M_ebf U11^-1 M_efb)",
        "(M_eb - Q - M_ebf J_thf^-1 J_thb)^-1 (M_eb - Q - s^2 M_ebf U11^-1 M_efb), "
        "Q = M_b12 (s^2 M_b22 + K_bm)^-1 s^2 M_b21",
        "first line of (56) with C by one solve of (25)",
        relative_error(right, S),
        relative_error(printed, S),
    )


def poles() -> Erratum:
    """(57): poles of the loop of nominal plant and optimal controller."""
    d, damped = case.dynamics(), assemble_nominal(load(), case.pose())
    found, suspension, arrays = _poles_of_the_loop(d), _roots_57(), _free_array_roots()
    below = 1.5 * np.abs(arrays).max()  # rad/s: between the arrays and the suspension
    hertz = np.abs(arrays) / (2.0 * np.pi)
    undamped, real = (poles[np.abs(poles) < below].real for poles in (found, _poles_of_the_loop(damped)))
    return Erratum(
        "(57)",
        "poles: det(s^2 M_ef + s C_f + K_f) = 0",
        "also det(U22 - U21 J_thf^-1 J_thb) = 0: the free modes of the arrays",
        f"eigenvalues of the closed loop in all {d.active.sum()} coordinates; errors: largest distance of a pole from "
        f"the nearest root. The {len(arrays)} array poles, {hertz.min():.2f} to {hertz.max():.2f} Hz, have real parts "
        f"up to {np.abs(undamped).max():.0e} rad/s; with the modal damping of the parameter set {real.min():.3f} to "
        f"{real.max():.3f} rad/s",
        _largest_distance(found, np.concatenate([suspension, arrays])),
        _largest_distance(found, suspension),
    )


def robust_factor() -> Erratum:
    """(60): the delay of section 4.2 as the uncertainty."""
    nominal, s = case.nominal(), case.S
    delayed = np.exp(-s * published_numbers()["text.delay"].value)[:, None, None]
    loop = case.plant().C(s) @ case.optimal_gains().optimal(s)
    E, T = np.eye(6) + 0.0j, nominal_complement(nominal, s)
    practical = np.linalg.inv(E - delayed * loop)
    delta_T = (delayed - 1.0) * T

    def product(S_delta_inverse: Complex) -> Complex:
        return np.asarray((E - T) @ np.linalg.inv(S_delta_inverse))

    return Erratum(
        "(60)",
        "S_Delta = (E - Delta T)^-1",
        "S_Delta = (E + Delta T)^-1; the small-gain test (62) is the same",
        "S' = (E - C' K)^-1 against S S_Delta, with the delay of section 4.2 as Delta and C by one solve of (25)",
        relative_error(product(E + delta_T), practical),
        relative_error(product(E - delta_T), practical),
    )


ENTRIES = (optimal_controller, gains_and_signals, sensitivity, poles, robust_factor)


def _poles_of_the_loop(d: Dynamics) -> Complex:
    """Eigenvalues, rad/s, of a nominal system under the optimal force, but for those of the free base at zero."""
    g, on = case.optimal_gains(), np.flatnonzero(d.active)
    closed = []
    for matrix, gain in ((d.M, g.acceleration), (d.C, g.velocity), (d.K, g.displacement)):
        with_force = matrix.copy()
        with_force[d.slices["d_f"], d.slices["q_b"]] -= gain
        closed.append(with_force[np.ix_(on, on)])
    found = _quadratic_roots(*closed)
    return np.asarray(found[np.abs(found) > 0.1])  # rad/s; the base's are at zero but for rounding


def _roots_57() -> Complex:
    """Roots of (57), rad/s."""
    d, d_f = case.dynamics(), case.dynamics().slices["d_f"]
    return _quadratic_roots(d.M[d_f, d_f], d.C[d_f, d_f], d.K[d_f, d_f])


def _free_array_roots() -> Complex:
    """Roots of det(U22 - U21 J_thf^-1 J_thb) = 0 other than zero, rad/s: of base and modes, the payload not turning."""
    d = case.dynamics()
    q_b, x_m = d.slices["q_b"], d.slices["x_m"]
    both = slice(q_b.start, x_m.stop)
    M, K = d.M[both, both].copy(), d.K[both, both]
    M[:6, :6] -= d.M[q_b, d.slices["d_f"]] @ case.following_matrix()
    squares = np.linalg.eigvals(np.linalg.solve(M, -K)).astype(complex)
    omega = np.sqrt(squares[np.abs(squares) > 0.01])
    return np.concatenate([omega, -omega])


def _quadratic_roots(M: Array, C: Array, K: Array) -> Complex:
    """Roots of det(s^2 M + s C + K) = 0."""
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, C)]])
    return np.asarray(np.linalg.eigvals(A).astype(complex))


def _largest_distance(values: Complex, roots: Complex) -> float:
    """Largest relative distance of a value from the nearest root."""
    return float((np.abs(values[:, None] - roots).min(axis=1) / np.abs(values)).max())


def range_of_orientations() -> Erratum:
    """The claim of the conclusions."""
    reach = compute_reach()
    pitch = reach.pure[1]
    return Erratum(
        "Table 1, section 5",
        f"any roll, pitch and yaw within +-{CLAIMED_LIMIT:g} deg can be reached",
        f"any within +-{reach.cube:.2f} deg",
        f"inverse kinematics and stroke: pitch alone reaches {pitch[0]:+.2f} to {pitch[1]:+.2f} deg, and the largest "
        f"cube of roll, pitch and yaw is that of +-{reach.cube:.2f} deg; the error is by how much the cube is "
        "overstated. Table 1 holds the extremes of each angle wherever they occur",
        error_printed=CLAIMED_LIMIT - reach.cube,
        unit="deg",
    )


def rejection_of_table_2() -> Erratum:
    """Table 2: a quotient."""
    numbers = published_numbers()
    passive, active, said = (numbers[f"table2.roll_{what}_3"].value for what in ("passive", "active", "rejection"))
    follows = 100.0 * (1.0 - active / passive)
    return Erratum(
        "Table 2, (8.5, 0, 0) deg, axis 3",
        f"{said:g} %",
        f"{follows:.2f} %",
        f"1 - {active:g} / {passive:g}, the RMS values beside it",
        error_printed=abs(said - follows),
        unit="points",
    )


def verdict_on_the_lighter_module() -> Erratum:
    """Fig 10: the critical point."""
    delay = published_numbers()["text.delay"].value
    lsm = judge("LSM", delay)
    return Erratum(
        "Fig 10, section 4.2",
        f"LSM with {delay:g} s delay is unstable: margins of +C K_we against -1",
        "stable: by (48) the critical point is +1",
        f"argument principle: {lsm.unstable_poles} poles in the right half-plane about +1, {lsm.encirclements} if the "
        f"point were -1; the rightmost pole of the suspension is at {lsm.rightmost.real:.2f} "
        f"{lsm.rightmost.imag:+.2f}i rad/s; the loop becomes unstable beyond a delay of {1e3 * lsm.delay_limit:.1f} "
        f"ms, by bisection {1e3 * lsm.bisected:.1f} ms",
    )


RESULT_ENTRIES = (range_of_orientations, rejection_of_table_2, verdict_on_the_lighter_module)
