"""The pointing controller: its response, its notch, its integrals and what a limit does to them."""

from dataclasses import replace

import numpy as np
import pytest
from support.mechanics import PAPER, fixed_base, pose_at

from ps_fmu.control.isolator import UnreachableOrientationError
from ps_fmu.control.pointing import DEFAULT_DESIGN, LoopDesign, PointingLaw
from ps_fmu.mechanism.dynamics import assemble
from ps_fmu.mechanism.quantities import ParameterError, replace_values
from ps_fmu.theory.transfer_matrices import Nominal

LAW = PointingLaw.from_parameters(PAPER)
S = 2j * np.pi * np.array([1e-3, 0.1, 1.0, 5.2, 40.0])


@pytest.mark.parametrize("rpy_deg", [(0.0, 0.0, 0.0), (4.0, -3.0, 10.0)])
def test_the_state_space_has_the_response_of_the_equation(rpy_deg):
    controller = LAW.controller(np.radians(rpy_deg))
    A, B, C = controller.matrices()
    found = np.array([C @ np.linalg.solve(s * np.eye(12) - A, B[:, :3]) for s in S])
    np.testing.assert_allclose(found, controller.response(S), rtol=1e-12)


@pytest.mark.parametrize("rpy_deg", [(0.0, 0.0, 0.0), (4.0, -3.0, 10.0)])
def test_the_notch_undoes_the_suspension_of_all_axes(rpy_deg):
    """On a base that does not move the loop is k(s) E, when the controller knows the payload."""
    rigid = replace(PAPER.payload, truss_modes=())
    pose = pose_at(rpy_deg)
    plant = fixed_base(Nominal(assemble(PAPER.manipulator, rigid, PAPER.bus, pose)), S)
    notch = replace(LAW, payload=rigid).notch(pose).response(S)
    expected = np.broadcast_to(np.eye(3), (len(S), 3, 3))
    np.testing.assert_allclose(pose.rotation_BP.T @ plant @ notch, expected, atol=1e-10)


def test_gain_is_one_near_the_crossover_and_falls_with_the_slopes_of_the_equation():
    simple = LoopDesign(1.0, 0.0, 1e3, 0.7)
    assert abs(simple.response(2j * np.pi)) == pytest.approx(1.0, rel=1e-5)
    low = np.abs(DEFAULT_DESIGN.response(2j * np.pi * np.array([1e-4, 1e-3])))
    high = np.abs(DEFAULT_DESIGN.response(2j * np.pi * np.array([1e3, 1e4])))
    assert low[0] / low[1] == pytest.approx(100.0, rel=1e-3)
    assert high[0] / high[1] == pytest.approx(1000.0, rel=1e-3)


def test_a_step_is_exact_for_a_held_error():
    """Ten small steps are one large one."""
    controller = LAW.controller(np.zeros(3))
    u = np.array([1e-6, -2e-6, 3e-6, 1e-3, 0.0, -1e-3])
    small, large = controller.hold(1e-3), controller.hold(1e-2)
    x = np.zeros(12)
    for _ in range(10):
        x = small[0] @ x + small[1] @ u
    np.testing.assert_allclose(x, large[1] @ u, rtol=1e-9, atol=1e-20)


def follow(angle, *, limit=np.inf, steps=4000, h=5e-3, back_calculated=True):
    """Rotation of a payload on springs alone that is to follow ``angle`` of time, (steps, 3), rad; no dynamics."""
    controller = LAW.controller(np.zeros(3))
    Ad, Bd = controller.hold(h)
    C, back = controller.output_map(), np.linalg.inv(controller.notch.stiffness)
    x, theta, found, excess = np.zeros(12), np.zeros(3), [], np.zeros(3)
    for k in range(steps):
        error = angle(k * h) - theta
        x = Ad @ x + Bd @ np.concatenate([error, excess])
        force = np.clip(C @ x, -limit, limit)
        excess = back_calculated * (C @ x - force)
        theta = back @ force
        found.append(theta)
    return np.array(found)


def test_neither_a_turn_nor_a_constant_rate_leaves_an_error():
    turn = np.array([1e-4, -2e-5, 3e-5])
    assert np.abs(follow(lambda t: turn)[-1] - turn).max() < 1e-12
    rate = turn / 10.0  # rad/s
    found = follow(lambda t: rate * t, steps=4000)
    assert np.abs(found[-1] - rate * 4000 * 5e-3).max() < 1e-11


def test_a_force_at_its_limit_does_not_wind_the_integrals_up():
    """Five seconds out of reach; then the target comes back within, and the payload is there two seconds later."""
    reach, beyond = np.array([1e-5, 0.0, 0.0]), np.array([1e-3, 0.0, 0.0])
    limit = 3.0 * np.abs(LAW.controller(np.zeros(3)).notch.stiffness @ reach).max()
    late = {}
    for back_calculated in (True, False):
        found = follow(lambda t: beyond if t < 5.0 else reach, limit=limit, steps=2000, back_calculated=back_calculated)
        late[back_calculated] = np.abs(found[1400:, 0] - reach[0]).max()
    assert late[True] < 0.1 * reach[0] < late[False]


def test_what_the_mechanism_cannot_take_up_is_refused_by_name():
    low_platform = replace_values(LAW, {"nominal_translation.z": 0.15})  # m
    with pytest.raises(UnreachableOrientationError, match="no pose with the fine legs at rest"):
        low_platform.controller(np.array([1.5, 0.0, 0.0]))
    with pytest.raises(ParameterError, match="crossover_frequency: must be greater than 0"):
        LoopDesign(0.0, 0.1, 5.0, 0.7)
