"""The nonlinear prototype over time: what must be conserved is, and a slew moves the plant FMU in the same way."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from support.cosim import Collect
from support.importers import needs_pinocchio
from support.mechanics import pose_at, rigid
from support.multibody.motion import following, locked, simulate
from support.multibody.multibody import Prototype

from ps_fmu.cosim import Master, read_system
from ps_fmu.mechanism.rotations import roll_pitch_yaw

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
STEP = 5e-3  # s
END = 27.0  # s; the default slew is over
NO_MODES = {
    **{f"plant.bus.mode_{i}.frequency": 0.0 for i in range(1, 7)},
    **{f"plant.payload.truss_mode_{i}.frequency": 0.0 for i in (1, 2)},
    "plant.coarse_rods.axial_stiffness": 0.0,
}
UNDISTURBED = {"disturbance.noise.enabled": False, "isolator.enabled": False}


@pytest.fixture(autouse=True, scope="module")
def _pinocchio():
    needs_pinocchio()


def test_energy_and_momentum_of_a_tumbling_system():
    """A light bus, so that the mechanism counts; no damping; all nonlinear forces of the legs take part."""
    parameters = rigid()
    bus = replace(parameters.bus, mass=40.0, com_B=np.array([0.02, -0.03, -0.2]), inertia_B=np.diag([2.0, 3.0, 2.5]))
    undamped = tuple(replace(leg, damping=0.0) for leg in parameters.manipulator.fine_legs)
    parameters = replace(parameters, bus=bus, manipulator=replace(parameters.manipulator, fine_legs=undamped))
    prototype = Prototype(parameters, leg_radius=0.03)
    rates = np.array([0.02, -0.01, 0.03, 0.1, -0.2, 0.1, 0.3, -0.5, 0.4, 0.0, 0.0, 0.0])  # m/s, rad/s
    motion = simulate(prototype, pose_at((8.5, 0.0, 0.0)), rates, locked, np.linspace(0.0, 0.5, 11))
    states = list(zip(motion.q, motion.v, strict=True))
    energy = np.array([prototype.energy(*state) for state in states])
    momentum = np.array([prototype.momentum(*state) for state in states])
    assert np.ptp(energy) < 1e-8 * energy[0]
    assert np.ptp(momentum, axis=0).max() < 1e-8 * np.abs(momentum).max()
    stretch = np.array([prototype.lengths(q)[3:] for q in motion.q])
    assert np.ptp(stretch, axis=0).min() > 2e-4  # m


@pytest.fixture(scope="module")
def slews(_pinocchio, built_fmus):
    """The default slew, roll 0 to 8.5 deg: plant FMU and prototype, both rigid but for the fine legs."""
    system = read_system(SYSTEM, built_fmus).with_parameters({**NO_MODES, **UNDISTURBED})
    seen = Collect()
    with Master(system, STEP) as master:
        master.initialise()
        master.set("commander.target.roll", np.radians(8.5))
        master.run(END, [seen])
        names = [column.name for column in master.columns]

    def recorded(name, *suffixes):
        return np.column_stack([seen.values[:, names.index(f"{name}{suffix}")] for suffix in suffixes])

    legs, xyz = ("_1", "_2", "_3"), (".x", ".y", ".z")
    fmu = {
        "base position": recorded("plant.base_position", *xyz),
        "base rotation": recorded("plant.base_rotation", *xyz),
        "orientation": recorded("plant.relative_orientation", ".roll", ".pitch", ".yaw"),
        "coarse": recorded("plant.coarse_displacement", *legs),
        "fine": recorded("plant.fine_displacement", *legs),
    }
    # In a step the plant's reference goes to the command at the step's beginning: it is one step late.
    command = CubicSpline(seen.time, recorded("commander.coarse_command", *legs))
    parameters = rigid()
    prototype = Prototype(parameters)
    legs_move = following(lambda t: command(max(t - STEP, 0.0)), parameters.servo)
    motion = simulate(prototype, pose_at((0.0, 0.0, 0.0)), np.zeros(12), legs_move, seen.time[::10], 1e-10)
    rotations = [prototype.rotations(q) for q in motion.q]
    nominal = parameters.manipulator.geometry.nominal_lengths
    displacement = np.array([prototype.lengths(q) for q in motion.q]) - nominal
    multibody = {
        "base position": np.array([q[:3] @ base for q, (base, _) in zip(motion.q, rotations, strict=True)]),  # in B
        "base rotation": np.array([Rotation.from_matrix(base).as_rotvec() for base, _ in rotations]),
        "orientation": roll_pitch_yaw(np.array([platform for _, platform in rotations])),
        "coarse": displacement[:, :3],
        "fine": displacement[:, 3:],
    }
    return {name: values[::10] for name, values in fmu.items()}, multibody


def test_the_legs_are_moved_alike(slews):
    fmu, multibody = slews
    assert np.abs(fmu["coarse"]).max() > 0.015  # m
    np.testing.assert_allclose(fmu["coarse"], multibody["coarse"], rtol=0.0, atol=5e-9)


@pytest.mark.parametrize(("quantity", "limit"), [("base position", 5e-9), ("base rotation", 1.2e-8)])  # m, rad
def test_a_slew_moves_the_bus_alike(slews, quantity, limit):
    fmu, multibody = slews
    assert np.abs(multibody[quantity]).max() > 1e-4  # m, rad
    assert np.abs(fmu[quantity] - multibody[quantity]).max() < limit


def test_a_slew_turns_the_payload_alike(slews):
    """Convective forces within the mechanism included; nothing is left at rest."""
    fmu, multibody = slews
    assert np.abs(fmu["orientation"] - multibody["orientation"]).max() < 4e-8  # rad; a leg moves by 25 um in a step
    np.testing.assert_allclose(fmu["orientation"][-1], multibody["orientation"][-1], rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(fmu["fine"][-1], multibody["fine"][-1], rtol=0.0, atol=1e-10)
