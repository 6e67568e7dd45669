"""Feedforward control and its stability: (50) to (60); claims about results: Tables 1 and 2, Fig 10."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...mechanism.dynamics import Dynamics
from ...mechanism.parameters import load
from ...theory.small_gain import nominal_complement, nominal_loop_poles, quadratic_roots
from ...theory.transfer_matrices import Complex
from ..bus_cases import assemble_nominal
from ..figures.fig06 import CLAIMED_LIMIT, compute_reach
from ..figures.fig10.closed_form import judge
from ..published import published_numbers
from . import case
from .case import Erratum, make_erratum, relative_error


def optimal_controller() -> Erratum:
    """(50), fourth line."""
    nominal, plant, J, s = case.nominal(), case.plant(), case.dynamics().jacobians, case.S
    U11, U12, U21, _ = nominal.U(s)
    G_P, G22, inverse = plant.G_P(s), nominal.D(s), np.linalg.inv(U11)
    optimal = -np.linalg.solve(plant.A(s) - G_P @ plant.C(s), G_P)

    def fourth_line(G: Complex) -> Complex:
        bracket = nominal.G11(s) - inverse @ U12 @ G @ U21 @ inverse
        return np.asarray(-np.linalg.solve(J.J_theta_f @ bracket, G_P))

    return make_erratum(
        "(50), line 4",
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

    return make_erratum("(51) to (54), (55)", left(right.optimal(s)), left(printed.optimal(s)))


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
    return make_erratum("(56), last line", relative_error(right, S), relative_error(printed, S))


def poles() -> Erratum:
    """(57): poles of the loop of nominal plant and optimal controller."""
    d, damped = case.dynamics(), assemble_nominal(load(), case.pose())
    found, roots = _poles_of_the_loop(d), nominal_loop_poles(d)
    suspension, arrays = np.split(roots, [6])  # of (57); free modes of the arrays
    below = 1.5 * np.abs(arrays).max()  # rad/s: between the arrays and the suspension
    hertz = np.abs(arrays) / (2.0 * np.pi)
    undamped, real = (poles[np.abs(poles) < below].real for poles in (found, _poles_of_the_loop(damped)))
    return make_erratum(
        "(57)",
        _largest_distance(found, roots),
        _largest_distance(found, suspension),
        coordinates=d.active.sum(), count=len(arrays), lowest=hertz.min(), highest=hertz.max(),
        undamped=np.abs(undamped).max(), least=real.min(), most=real.max(),
    )  # fmt: skip


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

    return make_erratum(
        "(60)",
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
    found = quadratic_roots(*closed)
    return np.asarray(found[np.abs(found) > 0.1])  # rad/s; the base's are at zero but for rounding


def _largest_distance(values: Complex, roots: Complex) -> float:
    """Largest relative distance of a value from the nearest root."""
    return float((np.abs(values[:, None] - roots).min(axis=1) / np.abs(values)).max())


def range_of_orientations() -> Erratum:
    """The claim of the conclusions."""
    reach = compute_reach()
    pitch = reach.pure[1]
    return make_erratum(
        "Table 1, section 5",
        error_printed=CLAIMED_LIMIT - reach.cube,
        claimed=CLAIMED_LIMIT, cube=reach.cube, low=pitch[0], high=pitch[1],
    )  # fmt: skip


def rejection_of_table_2() -> Erratum:
    """Table 2: a quotient."""
    numbers = published_numbers()
    passive, active, said = (numbers[f"table2.roll_{what}_3"].value for what in ("passive", "active", "rejection"))
    follows = 100.0 * (1.0 - active / passive)
    return make_erratum(
        "Table 2, (8.5, 0, 0) deg, axis 3",
        error_printed=abs(said - follows),
        said=said, follows=follows, active=active, passive=passive,
    )  # fmt: skip


def verdict_on_the_lighter_module() -> Erratum:
    """Fig 10: the critical point."""
    delay = published_numbers()["text.delay"].value
    lsm = judge("LSM", delay)
    return make_erratum(
        "Fig 10, section 4.2",
        delay=delay, unstable=lsm.unstable_poles, about_minus_one=lsm.encirclements, real=lsm.rightmost.real,
        imag=lsm.rightmost.imag, limit_ms=1e3 * lsm.delay_limit, bisected_ms=1e3 * lsm.bisected,
    )  # fmt: skip


RESULT_ENTRIES = (range_of_orientations, rejection_of_table_2, verdict_on_the_lighter_module)
