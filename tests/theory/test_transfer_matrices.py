"""Transfer matrices against the multibody reference, against each other and against their limits."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.mechanics import (
    ORIENTATIONS_DEG,
    PAPER,
    complex_array,
    dynamics_at,
    pose_at,
    reference_cases,
    reference_pose,
    relative_error,
    rigid,
)

from ps_fmu.mechanism.parameters import load
from ps_fmu.theory.transfer_matrices import Nominal, Practical

S = 2j * np.pi * np.geomspace(0.05, 300.0, 40)  # rad/s


@pytest.mark.parametrize("model", [Nominal, Practical])
@pytest.mark.parametrize("case", reference_cases(), ids=lambda c: str(c["orientation_rpy_deg"]))
def test_multibody_reference(case: dict, model: type) -> None:
    """G_P, A and C of the nonlinear prototype within 1e-9 relative at both orientations."""
    transfer = model(dynamics_at(reference_pose(case), rigid()))
    s = 2j * np.pi * np.array(case["frequency_hz"])
    verify_claim(
        "model.transfer_matrices",
        claim="Transfer matrices of the plant",
        where="`ps-fmu analyse transmissibility`, `stability`, `budget`: closed forms",
        reference="nonlinear multibody program (Pinocchio), linearised, at two orientations",
        error=[relative_error(getattr(transfer, name)(s), complex_array(case[name])) for name in ("G_P", "A", "C")],
        bound=1e-9,
    )


@pytest.mark.parametrize("rpy_deg", ORIENTATIONS_DEG)
def test_transmissibility_begins_at_one_and_ends_at_the_feedthrough(rpy_deg) -> None:
    nominal = Nominal(dynamics_at(pose_at(rpy_deg)))
    J = nominal.dynamics.jacobians
    np.testing.assert_allclose(nominal.G_P(2j * np.pi * 1e-6), J.J_theta_b, atol=1e-9)
    np.testing.assert_allclose(J.J_theta_b, np.hstack([np.zeros((3, 3)), np.eye(3)]), atol=1e-13)  # (39) in B
    M, d_f, q_b = nominal.dynamics.M, *(nominal.dynamics.slices[name] for name in ("d_f", "q_b"))
    feedthrough = J.J_theta_b - J.J_theta_f @ np.linalg.solve(M[d_f, d_f], M[d_f, q_b])  # (40)
    np.testing.assert_allclose(nominal.G_P(2j * np.pi * 1e8), feedthrough, atol=1e-7)


def test_transmissibility_is_immune_to_bus_modes_and_bus_mass() -> None:
    """The statement below eq (38), for the nominal model and for the practical plant."""
    pose = pose_at((8.5, 0.0, 0.0))
    heavy, light = (
        dynamics_at(pose),
        dynamics_at(pose, rigid(replace(PAPER, bus=replace(PAPER.bus, mass=933.0)))),
    )
    np.testing.assert_allclose(Nominal(heavy).G_P(S), Nominal(light).G_P(S), rtol=1e-9, atol=1e-12)
    no_modes = replace(PAPER, bus=replace(PAPER.bus, modes=()))
    practical, without = Practical(heavy), Practical(dynamics_at(pose, no_modes))
    assert relative_error(practical.G_P(S), without.G_P(S)) < 1e-8
    assert relative_error(practical.C(S), without.C(S)) > 1e-2  # A and C do depend on them


def test_practical_plant_with_rigid_groups_is_the_nominal_model() -> None:
    """Same equations, two routes: the Schur complements of (33)-(36) and one solve with all coordinates."""
    bus = replace(PAPER.bus, modes=tuple(replace(m, damping_ratio=0.0) for m in PAPER.bus.modes))
    parameters = replace(rigid(), bus=bus)
    d = dynamics_at(pose_at((0.0, -7.0, 0.0)), parameters)
    for name in ("A", "B", "C", "D", "G_P"):
        assert relative_error(getattr(Practical(d), name)(S), getattr(Nominal(d), name)(S)) < 1e-9, name


def test_sign_of_the_modal_term() -> None:
    """U22 of (29), (30) is what remains of base and modes when the modes are eliminated: minus, not plus as printed."""
    d = dynamics_at(pose_at((0.0, 0.0, 0.0)), replace(rigid(), bus=PAPER.bus))
    q_b, x_m = d.slices["q_b"], d.slices["x_m"]
    _, _, _, U22 = Nominal(d).U(S)
    s2 = (S * S)[:, None, None]
    coupling, stiffness = s2 * d.M[x_m, q_b], s2 * d.M[x_m, x_m] + d.K[x_m, x_m]
    modal = np.swapaxes(coupling, -1, -2) @ np.linalg.solve(stiffness, coupling)
    assert relative_error(U22, s2 * d.M[q_b, q_b] - modal) < 1e-12
    assert relative_error(U22, s2 * d.M[q_b, q_b] + modal) > 1e-2


@pytest.mark.parametrize(("bus", "estimate", "peak"), [("OSM", 0.0144, 0.041), ("LSM", 0.125, 2.04)])
def test_mobile_base_factor(bus: str, estimate: float, peak: float) -> None:
    """(42) is the value away from resonances; the supremum (41), with damped modes, is many times that."""
    d = dynamics_at(pose_at((0.0, 0.0, 0.0)), replace(rigid(), bus=load(bus=bus).bus))
    assert Nominal(d).mobile_base_estimate() == pytest.approx(estimate, rel=5e-3)
    factor = Practical(d).mobile_base_factor()
    assert factor == pytest.approx(peak, rel=2e-3)
    frequencies = np.linspace(0.4, 1.4, 20001)  # Hz
    on_a_grid = np.linalg.svd(Practical(d).Y(2j * np.pi * frequencies), compute_uv=False).max()
    assert factor * (1.0 - 1e-3) < on_a_grid < factor * (1.0 + 1e-6)


def test_mobile_base_factor_at_its_ends() -> None:
    """Without modes it is the estimate (42); with modes that nothing damps it is infinite; rods raise it too."""
    pose = pose_at((0.0, 0.0, 0.0))
    bare = dynamics_at(pose, rigid())
    assert Practical(bare).mobile_base_factor() == pytest.approx(Nominal(bare).mobile_base_estimate(), rel=1e-6)
    modes = tuple(replace(mode, damping_ratio=0.0) for mode in PAPER.bus.modes)
    undamped = dynamics_at(pose, replace(rigid(), bus=replace(PAPER.bus, modes=modes)))
    assert Practical(undamped).mobile_base_factor() == np.inf
    assert Practical(dynamics_at(pose)).mobile_base_factor() == pytest.approx(0.260, abs=1e-3)  # at 144 Hz


def test_plant_in_terms_of_the_mobile_base() -> None:
    """(43) and (44) with U12 Y in place of the printed Y U21, whose dimensions do not match; Y has two routes."""
    bus = replace(PAPER.bus, modes=tuple(replace(m, damping_ratio=0.0) for m in PAPER.bus.modes))
    d = dynamics_at(pose_at((8.5, 0.0, 0.0)), replace(rigid(), bus=bus))
    nominal, J = Nominal(d), d.jacobians
    U11, U12, _, _ = nominal.U(S)
    Y = nominal.Y(S)
    assert relative_error(Practical(d).Y(S), Y) < 1e-9
    G11 = np.linalg.inv(U11 - U12 @ Y)
    assert relative_error(-Y @ G11, nominal.C(S)) < 1e-12
    assert relative_error((J.J_theta_f - J.J_theta_b @ Y) @ G11, nominal.A(S)) < 1e-12


def test_scalar_and_array_frequencies_agree() -> None:
    practical = Practical(dynamics_at(pose_at((0.0, 0.0, 14.0))))
    assert practical.B(S[3]).shape == (3, 6)
    np.testing.assert_array_equal(practical.B(S)[3], practical.B(S[3]))
