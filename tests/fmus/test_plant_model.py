"""ManipulatorPlant driven as a Python object: what its ports mean, events, state."""

import numpy as np
import pytest
from support.mechanics import PAPER
from support.models import Host

from ps_fmu.slavekit.author.slave import ModelError, Refused

ORIENTATION = ("orientation.roll", "orientation.pitch", "orientation.yaw")
H = 1e-3  # s


def test_every_number_of_the_parameter_set_is_a_parameter_with_its_value() -> None:
    host = Host("manipulator_plant")
    names = ("payload.mass", "bus.mode_1.frequency", "fine_leg_2.stiffness", "bus.com.z")
    assert host.get(*names) == [14.89, 0.4545, 32051.8, -2.0]


def test_acceleration_under_a_base_force_is_newtons_law() -> None:
    host = Host("manipulator_plant", base_force__x=100.0).run_mode()
    host.step(1e-4)
    # The centre of mass lies 2 m below the base frame: force / mass, and rotation about it.
    expected = 100.0 / PAPER.bus.mass + 100.0 * 2.0**2 / PAPER.bus.inertia_B[1, 1]
    assert host.get("base_acceleration.x")[0] == pytest.approx(expected, rel=0.03)


def test_initial_outputs_follow_inputs_set_in_initialisation_mode() -> None:
    host = Host("manipulator_plant")
    assert host.get(*ORIENTATION) == pytest.approx([0.0, 0.0, 0.0], abs=1e-15)
    host.set(coarse_command_1=0.005)
    assert host.get("coarse_displacement_1") == [0.005]
    assert abs(host.get(*ORIENTATION)[0]) > 0.01
    host.set(base_force__z=10.0)
    assert host.get("base_acceleration.z")[0] > 1e-3


def test_coarse_command_moves_the_platform_there_exactly() -> None:
    host, there = (
        Host("manipulator_plant").run_mode(),
        Host("manipulator_plant", coarse_command_2=2e-4).run_mode(),
    )
    host.set(coarse_command_2=2e-4)
    host.step(H, 3000)
    assert host.get("coarse_displacement_2")[0] == pytest.approx(2e-4, abs=1e-18)
    assert host.get(*ORIENTATION) == pytest.approx(there.get(*ORIENTATION), abs=1e-15)


def test_command_beyond_the_stroke_is_held_and_said_once() -> None:
    host = Host("manipulator_plant").run_mode()
    host.set(coarse_command_3=0.05)
    host.step(H, 20)
    assert host.messages().count("coarse_command_3: 0.05 m is outside the stroke") == 1
    assert 0.0 < host.get("coarse_displacement_3")[0] <= 0.02


def test_start_beyond_the_stroke_is_held() -> None:
    host = Host("manipulator_plant", coarse_command_3=0.05).run_mode()
    assert host.get("coarse_displacement_3") == [0.02]


@pytest.mark.parametrize(
    ("start", "text"),
    [
        ({"payload__mass": 0.0}, r"payload\.mass: must be greater than 0"),
        ({"payload__truss_mode_1__mass": 20.0}, r"payload\.truss_mode_1\.mass: too large"),
        ({"bus__mode_2__participation__tz": 200.0}, r"bus\.mode_2\.participation: too large"),
        (
            {"coarse_stroke__max": 0.3, "coarse_command_1": 0.25},
            r"coarse_stroke: too large: no usable pose with the coarse legs at \(250, 0, 0\) mm",
        ),
    ],
)
def test_impossible_parameter_is_named(start: dict[str, float], text: str) -> None:
    host = Host("manipulator_plant", **start)
    with pytest.raises(ModelError, match=text):
        host.slave.exit_initialization_mode()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_input_that_is_not_finite_is_refused_and_named(value: float) -> None:
    host = Host("manipulator_plant").run_mode()
    with pytest.raises(Refused, match=r"base_torque\.y"):
        host.set(base_torque__y=value)
    host.step(H)
    assert host.get("base_rotation.y") == [0.0]


def test_step_size_may_change() -> None:
    """Exact discretisation: the same input over the same time, whatever the steps."""
    coarse, fine = (Host("manipulator_plant", base_torque__z=3.0).run_mode() for _ in range(2))
    coarse.step(2e-3, 50)
    fine.step(1e-3, 100)
    np.testing.assert_allclose(coarse.slave.y, fine.slave.y, rtol=1e-8, atol=1e-14)


def test_rigid_variants() -> None:
    """A zero frequency or stiffness means rigid."""
    off = {f"bus__mode_{i}__frequency": 0.0 for i in range(1, 7)}
    off |= {f"payload__truss_mode_{i}__frequency": 0.0 for i in (1, 2)} | {"coarse_rods__axial_stiffness": 0.0}
    host = Host("manipulator_plant", fine_force_1=1.0, **off).run_mode()
    host.step(H, 10)
    assert host.slave.model.dynamics.active.sum() == 9
    assert host.get("fine_displacement_1")[0] > 0.0
