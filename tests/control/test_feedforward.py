"""Gains and filters of the feedforward controller."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import cheby2, freqs_zpk, zpk2sos
from support.mechanics import ORIENTATIONS_DEG, PAPER, dynamics_at, fixed_base, pose_at, rigid

from ps_fmu.control.feedforward import Controller, design_chebyshev, gains, lowpass
from ps_fmu.mechanism.rotations import skew
from ps_fmu.theory.transfer_matrices import Nominal, Practical

S = 2j * np.pi * np.geomspace(0.05, 300.0, 40)  # rad/s


@pytest.mark.parametrize("rpy_deg", ORIENTATIONS_DEG)
def test_optimal_gains_cancel_the_disturbance(rpy_deg) -> None:
    """G_P + A K_wop = 0 with A as the payload sees it for a given base motion, A - G_P C (eqs 49, 50), to 1e-12."""
    pose = pose_at(rpy_deg)
    nominal = Nominal(dynamics_at(pose, replace(rigid(), bus=PAPER.bus)))
    K = gains(PAPER.manipulator, PAPER.payload, pose).optimal(S)
    G_P, A, C = nominal.G_P(S), nominal.A(S), nominal.C(S)
    assert np.abs(G_P + (A - G_P @ C) @ K).max() < 1e-12
    np.testing.assert_allclose(A - G_P @ C, fixed_base(nominal, S), atol=1e-12 * np.abs(A).max())
    # Seen from the undisturbed base motion, through the loop (48): the payload does not move at all.
    loop = np.linalg.inv(np.eye(6) - C @ K)
    assert np.abs(G_P + A @ K @ loop).max() < 1e-11


def test_gains_as_printed_in_55_do_not_cancel() -> None:
    """(55) as printed exchanges (52) and (54)."""
    pose = pose_at((0.0, 0.0, 0.0))
    nominal = Nominal(dynamics_at(pose, rigid()))
    right = gains(PAPER.manipulator, PAPER.payload, pose)
    printed = replace(right, acceleration=right.displacement, displacement=right.acceleration)
    s = S[S.imag < 2.0 * np.pi * 3.0]
    residual = nominal.G_P(s) + fixed_base(nominal, s) @ printed.optimal(s)
    assert np.abs(residual).max() > 10.0


def test_gains_do_not_need_the_payload_inertia() -> None:
    pose = pose_at((8.5, 0.0, 0.0))
    other = replace(PAPER.payload, inertia_P=2.0 * PAPER.payload.inertia_P)
    np.testing.assert_allclose(
        gains(PAPER.manipulator, other, pose).acceleration,
        gains(PAPER.manipulator, PAPER.payload, pose).acceleration,
        atol=1e-12,
    )


def test_lowpass_is_scipys_chebyshev() -> None:
    low = lowpass(PAPER.filters)
    frequencies = np.geomspace(0.01, 5000.0, 60)
    s = 2j * np.pi * frequencies
    ours = np.array([low.c @ np.linalg.solve(si * np.eye(9) - low.A, low.b) + low.d for si in s])
    _, theirs = freqs_zpk(*cheby2(9, 100.0, 2.0 * np.pi * 1000.0, analog=True, output="zpk"), worN=np.abs(s))
    assert np.abs(ours - theirs).max() < 1e-12
    assert low.d == 0.0


@pytest.mark.parametrize("attenuation", [3.0, 40.0, 100.0, 200.0])
@pytest.mark.parametrize("order", [1, 3, 5, 7, 9])
def test_sections_are_scipys_in_their_order(order: int, attenuation: float) -> None:
    zeros, poles, gain = cheby2(order, attenuation, 1.0, analog=True, output="zpk")
    theirs = zpk2sos(zeros, poles, gain, analog=True)
    theirs[:, :3] *= (theirs[:, 5] / theirs[:, 2])[:, None]  # static gain one in each
    np.testing.assert_allclose(design_chebyshev(order, attenuation), theirs, rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("order", [1, 3, 5, 7, 9])
def test_lowpass_has_unit_static_gain_and_no_feedthrough(order: int) -> None:
    low = lowpass(replace(PAPER.filters, lowpass_order=order))
    assert low.order == order
    assert low.d == 0.0
    assert -low.c @ np.linalg.solve(low.A, low.b) == pytest.approx(1.0, rel=1e-12)


def test_delay_of_the_lowpass_at_5_hz() -> None:
    """1661 us at 5 Hz: this delay times the suspension resonance is what remains of the jitter."""
    low = lowpass(PAPER.filters)
    s = 2j * np.pi * 5.0
    phase = np.angle(low.c @ np.linalg.solve(s * np.eye(9) - low.A, low.b))
    assert -phase / (2.0 * np.pi * 5.0) == pytest.approx(1661e-6, abs=1e-6)


def controller(rpy_deg=(0.0, 0.0, 0.0)) -> Controller:
    pose = pose_at(rpy_deg)
    known = replace(PAPER.payload, com_P=PAPER.known_com_P)
    return Controller(gains(PAPER.manipulator, known, pose), lowpass(PAPER.filters), PAPER.filters)


def test_practical_controller_is_eq_55_with_the_gains_in_their_places() -> None:
    c = controller()
    s = S[:, None, None]
    omega, zeta = 2.0 * np.pi * 1e-4, PAPER.filters.highpass_damping_ratio
    H2 = 1.0 / (s * s + 2.0 * zeta * omega * s + omega**2)
    low = c.lowpass
    M = np.array([low.c @ np.linalg.solve(si * np.eye(9) - low.A, low.b) for si in S])[:, None, None]
    expected = M * c.gains.acceleration + s * H2 * c.gains.velocity + H2 * c.gains.displacement
    np.testing.assert_allclose(c.response(S), expected, rtol=1e-9, atol=1e-9 * np.abs(expected).max())


def test_response_is_that_of_the_matrices() -> None:
    c = controller()
    A, B, C, D = c.matrices()
    s = 2j * np.pi * np.geomspace(1e-4, 1e4, 40)
    whole = C @ np.linalg.solve(s[:, None, None] * np.eye(len(A)) - A, B.astype(complex)) + D
    error = np.abs(c.response(s) - whole).max(axis=(1, 2))
    assert (error < 1e-12 * np.abs(whole).max(axis=(1, 2))).all()
    np.testing.assert_allclose(c.response(s[7]), c.response(s)[7], rtol=1e-14)


def test_discrete_controller_does_not_drift_where_a_direct_form_would() -> None:
    """A constant acceleration for 1000 s at 1e-4 s: the high-passed displacement stays on its analytic curve."""
    c = controller()
    step = c.step_map(1e-4)
    to_1000_s = np.linalg.matrix_power(np.block([[step[3:]], [np.zeros((6, c.n_states)), np.eye(6)]]), 10_000_000)
    u = np.array([1e-6, 0, 0, 0, 0, 0])  # m/s2
    displacement = (to_1000_s[: c.n_states, c.n_states :] @ u)[0]
    omega, zeta, t = 2.0 * np.pi * 1e-4, PAPER.filters.highpass_damping_ratio, 1000.0
    damped = omega * np.sqrt(1.0 - zeta**2)
    analytic = (
        u[0]
        / omega**2
        * (1.0 - np.exp(-zeta * omega * t) * (np.cos(damped * t) + zeta * omega / damped * np.sin(damped * t)))
    )
    assert displacement == pytest.approx(analytic, rel=1e-6)


@pytest.mark.parametrize(
    ("rpy_deg", "passive", "identified"),  # rad, published; %
    [
        ((0.0, 0.0, 0.0), (1.65e-5, 5.02e-6, 5.34e-6), (99.36, 99.17, 97.85)),
        ((8.5, 0.0, 0.0), (1.65e-5, 5.03e-6, 5.62e-6), (99.48, 98.94, 97.36)),
        ((0.0, -7.0, 0.0), (1.65e-5, 5.02e-6, 5.68e-6), (99.51, 98.53, 97.48)),
        ((0.0, 0.0, 14.0), (1.64e-5, 5.63e-6, 5.37e-6), (99.35, 98.50, 98.90)),
    ],
)
def test_table_2_in_closed_form(rpy_deg, passive, identified) -> None:
    """By frequency integral of the practical plant, one communication step of delay.

    Passive RMS within 1 % of what is published, rejection within 0.3 points of that of the identified set.
    """
    pose = pose_at(rpy_deg)
    plant, c = Practical(dynamics_at(pose)), controller(rpy_deg)
    f = np.concatenate([np.arange(0.1, 30.0, 0.002), np.geomspace(30.0, 1000.0, 2000)])  # Hz
    s = 2j * np.pi * f
    shift = np.block([[np.eye(3), np.zeros((3, 3))], [skew(PAPER.bus.com_B), np.eye(3)]])
    psd = shift @ PAPER.noise.wrench_psd_B @ shift.T
    K = c.response(s) * (s * s * np.exp(-1e-4 * s))[:, None, None]
    A, B, C, D = plant.A(s), plant.B(s), plant.C(s), plant.D(s)
    active = B + A @ K @ np.linalg.solve(np.eye(6) - C @ K, D)
    rms = []
    for T in (B, active):
        T_P = pose.rotation_BP.T @ T
        density = np.einsum("nij,jk,nik->ni", T_P, psd, T_P.conj()).real
        rms.append(np.sqrt(np.trapezoid(density, f, axis=0)))
    np.testing.assert_allclose(rms[0], passive, rtol=0.01)
    rejection = 100.0 * (1.0 - rms[1] / rms[0])
    np.testing.assert_allclose(rejection, identified, atol=0.3)
