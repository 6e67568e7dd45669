"""``ps_fmu.linearise``: systems of FMUs as linear systems, against closed forms of the analyses and of the physics."""

from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

import ps_fmu
from ps_fmu.cosim import read_system
from ps_fmu.cosim.errors import UsageError
from ps_fmu.interface.linear_system import Circuit
from ps_fmu.interface.system_model import SOURCE, read_model
from ps_fmu.mechanism.signals import OUTPUTS as SIGNALS

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
WRENCH = tuple(f"plant.base_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz")
ROTATION = tuple(f"payload_rotation.{axis}" for axis in "xyz")
OUTPUTS = [f"plant.{name}" for name in ROTATION]

pytestmark = pytest.mark.usefixtures("built_fmus")


@pytest.fixture(scope="module")
def linear(built_fmus):
    return ps_fmu.linearise("isolation", inputs=WRENCH, outputs=OUTPUTS)


def test_a_system_has_the_poles_and_responses_of_the_closed_form_of_its_steps(linear, built_fmus):
    """The closed form has the steps of the exchange; poles go to those of the continuous system with the step.

    Those of the high-pass, below 1e-3 rad/s, are left out: twelve lie together, and rounding moves them by 4e-4.
    """
    system = read_system(SYSTEM, built_fmus)
    poles, distances = np.linalg.eigvals(linear.A), []
    for step in (1e-4, 1e-5):
        theirs = Circuit(read_model(system, step), True).poles
        compared = theirs[(np.abs(theirs) > 1e-2) & (np.abs(theirs) < 3e3)]
        assert len(compared) == 28
        distances.append(max(np.abs(poles - pole).min() / abs(pole) for pole in compared))
    assert distances[0] < 1e-4
    assert distances[1] == pytest.approx(0.1 * distances[0], rel=0.01)
    frequency = np.geomspace(1.0, 100.0, 40)
    one, two = (Circuit(read_model(system, h), True).respond(frequency, ROTATION, [SOURCE]) for h in (1e-5, 2e-5))
    theirs = 2.0 * one - two
    ours = linear(2j * np.pi * frequency).transpose(2, 0, 1)
    error = np.abs(ours - theirs).max() / np.abs(theirs).max()
    verify_claim(
        "stability.linearised", claim="the responses of a system of FMUs, linearised by their directional derivatives",
        where="ps_fmu.linearise", reference="the closed form of the system's steps, extrapolated to no step",
        error=error, bound=2e-4,
    )  # fmt: skip


def test_the_plant_alone_is_its_linear_model(built_fmus):
    """Isolator and source taken as constant; names have underscores for dots."""
    found = ps_fmu.linearise(
        "isolation", inputs=["plant.fine_force_1"], outputs=[OUTPUTS[0], "plant.base_acceleration.z"],
        constant=["isolator"],
    )  # fmt: skip
    circuit = Circuit(read_model(read_system(SYSTEM, built_fmus)), False)
    A, B, C, D = circuit.model.loop.model.matrices()
    assert found.input_labels == ["plant_fine_force_1"]
    assert found.output_labels == ["plant_payload_rotation_x", "plant_base_acceleration_z"]
    s = 2j * np.pi * np.array([0.3, 4.0, 60.0])
    names = [name for signal in SIGNALS for name in signal.names]
    rows = [names.index("payload_rotation.x"), names.index("base_acceleration.z")]
    moving = np.flatnonzero(np.hstack([A, B]).any(axis=1) | A.any(axis=0))
    for k, point in enumerate(s):
        whole = np.linalg.solve(point * np.eye(len(moving)) - A[np.ix_(moving, moving)], B[moving, :1])
        expected = C[rows][:, moving] @ whole + D[rows, :1]
        np.testing.assert_allclose(found(s)[:, :, k], expected, rtol=1e-8)


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        ({"parameters": {"isolator.delay": 0.002}}, r"isolator: it is no linear .*delay = 0\.002 s: expected 0"),
        ({"what": "system/LineOfSight.ssd"}, r"tracker \(LineOfSightSensor\.fmu\): it provides no .*constant ="),
        ({"inputs": ["plant.base_torque.w"]}, r"inputs: plant\.base_torque\.w: expected a Real input"),
        ({"inputs": ["plant.coarse_command_1"]}, r"coarse_command_1: its FMU provides no derivative by it"),
        ({"inputs": ["isolator.enabled"]}, "expected a Real input"),
        ({"outputs": ["plant.locked_mass"]}, "plant: it is no linear continuous system now: .*not provided"),
        ({"outputs": ["disturbance.base_force.x"]}, r"disturbance \(DisturbanceSource\.fmu\): it provides no"),
        ({"constant": ["nobody"]}, "nobody"),
    ],
)
def test_what_is_not_linear_is_refused_by_name(given, problem):
    settings = {"what": "isolation", "inputs": WRENCH[:1], "outputs": OUTPUTS[:1]} | given
    with pytest.raises(UsageError, match=problem):
        ps_fmu.linearise(**settings)


def test_a_turning_plant_is_linearised_where_it_is():
    """A base that turns at 0.1 rad/s couples axes that are apart at rest."""
    given = {"inputs": WRENCH[3:4], "outputs": OUTPUTS[1:2], "constant": ["isolator"], "step": 1e-3}
    turn = {"plant.initial_angular_velocity.z": 0.1}
    rest, turning = (
        ps_fmu.linearise("isolation", parameters=values, at=0.02, **given)(0.5j) for values in ({}, turn)
    )
    assert abs(turning) > 5.0 * abs(rest)
