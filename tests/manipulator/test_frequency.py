"""Transfer matrices against the multibody reference, against each other and against their limits."""

from dataclasses import replace

import numpy as np
import pytest
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

from ps_fmu.manipulator.frequency import Nominal, Practical

S = 2j * np.pi * np.geomspace(0.05, 300.0, 40)  # rad/s


@pytest.mark.parametrize("model", [Nominal, Practical])
@pytest.mark.parametrize("case", reference_cases(), ids=lambda c: str(c["orientation_rpy_deg"]))
def test_multibody_reference(case: dict, model: type) -> None:
    """G_P, A and C of the nonlinear prototype within 1e-9 relative at both orientations."""
    transfer = model(dynamics_at(reference_pose(case), rigid()))
    s = 2j * np.pi * np.array(case["frequency_hz"])
    for name in ("G_P", "A", "C"):
        assert relative_error(getattr(transfer, name)(s), complex_array(case[name])) < 1e-9, name


@pytest.mark.parametrize("rpy_deg", ORIENTATIONS_DEG)
def test_transmissibility_begins_at_one_and_ends_at_the_feedthrough(rpy_deg) -> None:
    nominal = Nominal(dynamics_at(pose_at(rpy_deg)))
    J = nominal.dynamics.jacobians
    np.testing.assert_allclose(nominal.G_P(2j * np.pi * 1e-6), J.J_theta_b, atol=1e-9)
    np.testing.assert_allclose(J.J_theta_b, np.hstack([np.zeros((3, 3)), np.eye(3)]), atol=1e-13)  # (39) in B
    np.testing.assert_allclose(nominal.G_P(2j * np.pi * 1e8), nominal.feedthrough(), atol=1e-7)  # (40)


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
    """(29), (30) with minus; with the printed plus, D would be off by per cents around the bus modes."""
    d = dynamics_at(pose_at((0.0, 0.0, 0.0)), replace(rigid(), bus=PAPER.bus))
    nominal = Nominal(d)
    _, _, _, U22 = nominal.U(S)
    s2 = (S * S)[:, None, None]
    printed = 2.0 * s2 * d.M[d.slices["q_b"], d.slices["q_b"]] - U22  # the other sign
    assert relative_error(printed, U22) > 1e-2


def test_fixed_base_approximation_is_good_for_a_heavy_bus_only() -> None:
    """Eq (46): A is J_theta_f U11^-1 where Y is small."""
    pose = pose_at((0.0, 0.0, 0.0))
    errors = {}
    for mass in (9.13e3, 9.13e6):
        bus = replace(PAPER.bus, mass=mass, inertia_B=PAPER.bus.inertia_B * mass / 9.13e3, modes=())
        nominal = Nominal(dynamics_at(pose, replace(rigid(), bus=bus)))
        s = 2j * np.pi * np.array([0.5, 2.0, 20.0])
        errors[mass] = relative_error(nominal.A_fixed_base(s), nominal.A(s))
    assert errors[9.13e6] < 1e-4 < errors[9.13e3] < 0.1


def test_mobile_base_factor() -> None:
    """(42) is the value away from resonances; the true supremum is larger (0.0144 against 0.041 for OSM)."""
    nominal = Nominal(dynamics_at(pose_at((0.0, 0.0, 0.0))))
    assert nominal.mobile_base_estimate() == pytest.approx(0.0144, abs=2e-4)
    factor = nominal.mobile_base_factor(2j * np.pi * np.geomspace(0.05, 50.0, 4000))
    assert factor[-1] < 0.03
    assert factor.max() > 0.04


def test_scalar_and_array_frequencies_agree() -> None:
    practical = Practical(dynamics_at(pose_at((0.0, 0.0, 14.0))))
    assert practical.B(S[3]).shape == (3, 6)
    np.testing.assert_array_equal(practical.B(S)[3], practical.B(S[3]))
