"""ManipulatorPlant in motion: against a nonlinear multibody program, and what slews, swings and turns must keep."""

import numpy as np
import pytest
from support.claims import verify_claim
from support.host import unpack
from support.mechanics import to_rotation_matrix
from support.models import Host
from support.slew_cases import CASES, EVERY, STEP, load_reference
from support.twins import InFmpy

from ps_fmu.mechanism.momentum import Balance, count_balance
from ps_fmu.mechanism.rotations import from_rotation_vector, multiply
from ps_fmu.mechanism.signals import N_EXTERNAL, N_OUTPUTS, TIME, output_slices

PLACE = output_slices()
WRENCH = [f"base_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
COMMAND = [f"coarse_command_{i}" for i in (1, 2, 3)]
FAST = CASES["8.5 deg in 0.6 s"]
FINE_STEP = 1e-4  # s


def turn_between(p, q):
    """Small rotations (n, 3), rad, between attitudes (n, 4)."""
    return 2.0 * multiply(p * [1.0, -1.0, -1.0, -1.0], q / np.linalg.norm(q, axis=1)[:, None])[:, 1:]


@pytest.fixture(scope="module")
def simulate(built_fmus, tmp_path_factory):
    """The FMU through a case: rows of its first outputs after each EVERY steps, (n, outputs)."""
    folder = unpack(built_fmus / "ManipulatorPlant.fmu", tmp_path_factory.mktemp("plant") / "fmu")

    def run(case, wrench, **values):
        one = InFmpy(folder, "plant")
        given = {name.replace("__", "."): value for name, value in {**case.start_values, **values}.items()}
        given["servo.rate_limit"] = 1.0  # m/s: the command moves as the reference of the multibody program does
        one.set(given)
        one.initialise()
        slave, place = one.fmu, {name: variable.valueReference for name, variable in one.variables.items()}
        load, outputs, rows = [place[name] for name in WRENCH], list(range(PLACE["payload_attitude"].stop)), []
        command, parts = [place[name] for name in COMMAND], round(STEP / FINE_STEP)
        reference = np.zeros(3)
        for k in range(round(case.duration / STEP) + 1):
            if k % EVERY == 0:
                rows.append(slave.getReal(outputs))
            slave.setReal(load, wrench(k * STEP).tolist())
            limit = case.parameters.servo.rate_limit * STEP
            way = np.clip(case.command - reference, -limit, limit)
            for part in range(parts):
                slave.setReal(command, (reference + way * (part + 1) / parts).tolist())
                slave.doStep(k * STEP + part * FINE_STEP, FINE_STEP)
            reference = reference + way
        one.end()
        return np.array(rows)

    return run


@pytest.mark.parametrize("name", CASES)
def test_plant_moves_as_the_multibody_program(simulate, name):
    """README.md of the FMU has what is found."""
    reference, rows = load_reference()[name], simulate(CASES[name], CASES[name].wrench)
    for key, limit in (("base_attitude", 1.5e-7), ("payload_attitude", 1e-6)):  # rad
        assert np.abs(turn_between(reference[key], rows[:, PLACE[key]])).max() < limit
    off = []
    for key in ("fine_displacement", "base_acceleration"):
        wanted = reference[key][1:]
        off.append(np.abs(rows[1:, PLACE[key]] - wanted).max() / np.abs(wanted).max())
    verify_claim(
        "model.fast_slews",
        claim="Motion of bus, payload and fine legs in fast slews",
        where="`ps-fmu run slew`, `pointing`: all signals",
        reference="nonlinear multibody program (Pinocchio); attitudes are within 1e-6 rad",
        error=off,
        bound=2e-3,
        unit="of the largest value",
    )


def test_comparison_sees_the_convective_forces(simulate):
    """Without renewals of the linear model the same run is off by a millirad."""
    far = {"relinearisation_distance": 1.0, "relinearisation_speed": 1.0, "relinearisation_angle": 0.1}
    rows, reference = simulate(FAST, FAST.wrench, **far), load_reference()["8.5 deg in 0.6 s"]
    assert np.abs(turn_between(reference["payload_attitude"], rows[:, PLACE["payload_attitude"]])).max() > 1e-3


def move(case, steps, step=STEP):
    """The slave as a Python object, in the motion of a case that nothing disturbs."""
    host = Host("manipulator_plant", **case.start_values).run_mode()
    host.slave.view("coarse_command")[:] = case.command
    host.step(step, steps)
    return host


def find_momentum(slave):
    """Linear momentum and angular momentum about the centre of mass, (3,) each, and the centre of mass in B, (3,)."""
    numbers = np.zeros(count_balance(slave.model.dynamics.n))
    balance = Balance(slave.plant.system, numbers)
    balance.begin(slave.model, slave.state, 0.0)
    _, com_B = balance.find_momentum(slave.model, slave.state)
    return numbers[:3], numbers[3:6], com_B


def find_centre_of_mass(slave):
    """In inertial axes from where the origin of B was at the start, (3,) m."""
    q = slave.y[PLACE["base_attitude"]]
    _, _, com_B = find_momentum(slave)
    return to_rotation_matrix(q / np.linalg.norm(q)) @ (slave.y[PLACE["base_position"]] + com_B)


@pytest.mark.parametrize(
    ("name", "linear", "angular"),
    [
        ("8.5 deg in 0.6 s", 5e-11, 5e-11),
        ("8.5 deg in 0.6 s, bus of 60 kg", 5e-9, 5e-9),
        ("3, 5, -8 deg in 0.7 s, bus of 60 kg", 2e-9, 2e-9),
    ],
)  # N.s, N.m.s
def test_slew_leaves_no_momentum(name, linear, angular):
    """What the true momentum, carried on by all models, makes of the state; that of the payload alone is up to 3."""
    slave = move(CASES[name], 5000, FINE_STEP).slave
    assert np.abs(np.concatenate(find_momentum(slave)[:2])).max() < 1e-4  # between two models
    slave.state[:] = slave.balance.settle(slave.model, slave.state, slave.time)
    found = find_momentum(slave)
    assert np.abs(found[0]).max() < linear
    assert np.abs(found[1]).max() < angular


@pytest.mark.parametrize(
    ("name", "limit", "shift"),
    [
        ("8.5 deg in 0.6 s", 1e-10, 5e-5),
        ("8.5 deg in 0.6 s, bus of 60 kg", 6e-9, 5e-3),
        ("3, 5, -8 deg in 0.7 s, bus of 60 kg", 8e-9, 3e-3),
    ],
)
def test_centre_of_mass_does_not_creep_in_fast_slews_to_and_fro(name, limit, shift):
    case = CASES[name]
    host = Host("manipulator_plant", **case.start_values).run_mode()
    slave = host.slave
    first, moved = find_centre_of_mass(slave), 0.0
    for k in range(6):
        slave.view("coarse_command")[:] = case.command * (1 - k % 2)
        for _ in range(8):
            host.step(STEP, 100)
            assert np.abs(find_centre_of_mass(slave) - first).max() < limit  # m
            moved = max(moved, np.abs(slave.y[PLACE["base_position"]]).max())
    assert moved > shift  # m


def test_forces_move_momentum_and_centre_of_mass_as_they_must():
    """A force on the bus of 60 kg in inertial axes while it slews and turns: its impulse, and the integral of that."""
    case = CASES["3, 5, -8 deg in 0.7 s, bus of 60 kg"]
    host = Host("manipulator_plant", **case.start_values).run_mode()
    slave = host.slave
    slave.view("coarse_command")[:] = case.command
    first, force, mass = find_centre_of_mass(slave), np.array([0.6, -0.4, 0.8]), slave.model.dynamics.M[3, 3]  # N
    for _ in range(5000):
        half = slave.y[PLACE["base_angular_velocity"]] * (0.5 * FINE_STEP)
        q = multiply(slave.y[PLACE["base_attitude"]], from_rotation_vector(half))
        slave.view("base_force")[:] = to_rotation_matrix(q / np.linalg.norm(q)).T @ force
        host.step(FINE_STEP)
    q = slave.y[PLACE["base_attitude"]]
    momentum_B, _, _ = find_momentum(slave)
    found = to_rotation_matrix(q / np.linalg.norm(q)) @ momentum_B
    np.testing.assert_allclose(found, 0.5 * force, rtol=0.0, atol=3e-5)  # N.s
    shift = 0.5 * force / mass * 0.5**2
    np.testing.assert_allclose(find_centre_of_mass(slave) - first, shift, rtol=0.0, atol=2e-7)  # m
    assert np.abs(shift).max() > 1e-3


def find_jumps(case, duration, step):
    """(outputs,) largest differences of both models where one replaces the other, and how often; as host.step goes."""
    host = Host("manipulator_plant", **case.start_values).run_mode()
    slave = host.slave
    slave.view("coarse_command")[:] = case.command
    largest, renewals = np.zeros(N_OUTPUTS), 0
    for _ in range(round(duration / step)):
        model, x, since = slave.model, slave.state.copy(), slave.since.copy()
        host.step(step)
        if slave.model is not model:
            outputs, u = [], np.concatenate([slave.u[:N_EXTERNAL], slave.a])
            for each, state, time in (
                (model, x, since), (slave.model, slave.balance.start, (-slave.half, slave.half**2))
            ):  # fmt: skip
                u[TIME] = time
                outputs.append(each.output_map() @ np.concatenate([state, u]))
            largest, renewals = np.maximum(largest, np.abs(outputs[1] - outputs[0])), renewals + 1
    return largest, renewals


@pytest.mark.parametrize("step", [FINE_STEP, STEP])
@pytest.mark.parametrize(
    ("name", "turn", "shift"),
    [
        ("8.5 deg in 0.6 s", 3e-8, 1e-9),
        ("8.5 deg in 0.6 s, bus of 60 kg", 4e-8, 4e-9),
        ("bus at 1 deg/s, yaw 10 deg in 0.5 s", 7e-8, 5e-9),
    ],
)
def test_outputs_hardly_jump_where_the_linear_model_changes(name, turn, shift, step):
    """With the correction of the base's place and velocity; README.md has the figures."""
    largest, renewals = find_jumps(CASES[name], 0.6, step)
    assert renewals > 30
    for key in ("orientation", "relative_orientation", "base_attitude", "payload_attitude", "payload_rotation"):
        assert largest[PLACE[key]].max() < turn, key  # rad
    for key in ("base_position", "payload_position"):
        assert largest[PLACE[key]].max() < shift, key  # m


def test_after_a_slew_the_model_is_the_one_of_the_pose_at_rest():
    host = Host("manipulator_plant", servo__rate_limit=0.05).run_mode()
    host.set(coarse_command_2=2e-4)
    host.step(STEP, 2000)
    there = Host("manipulator_plant", coarse_command_2=2e-4).run_mode()
    np.testing.assert_array_equal(host.slave.centre[:15], there.slave.centre[:15])
    np.testing.assert_array_equal(host.slave.model.dynamics.M, there.slave.model.dynamics.M)


def test_a_slew_in_steps_of_any_size_ends_alike():
    """The reference reaches the command at the end of a step, so the way there differs; the end does not."""
    ends = []
    for step in (1e-3, 4e-3):
        host = Host("manipulator_plant", servo__rate_limit=0.02, fine_leg_1__damping=2e3).run_mode()
        host.set(coarse_command_1=3e-4)
        host.step(step, round(2.4 / step))
        ends.append(host.slave.y[PLACE["payload_attitude"]])
    np.testing.assert_allclose(ends[0], ends[1], rtol=0.0, atol=1e-7)


def test_a_body_that_turns_freely_keeps_its_rate_and_its_quaternion_unit():
    """About a principal axis; the small-angle output goes on as the integral of the rate."""
    rate = 0.03  # rad/s
    heavy = {f"bus__inertia__{axis}{axis}": 1e6 for axis in "xyz"}  # kg.m2
    host = Host("manipulator_plant", initial_angular_velocity__z=rate, **heavy).run_mode()
    host.step(1e-2, 300)
    q = host.slave.y[PLACE["base_attitude"]]
    assert abs(np.linalg.norm(q) - 1.0) < 2e-7
    np.testing.assert_allclose(q, from_rotation_vector(np.array([0.0, 0.0, rate * 3.0])), rtol=0.0, atol=1e-6)
    assert host.get("base_rotation.z")[0] == pytest.approx(rate * 3.0, rel=1e-6)


def test_centripetal_acceleration_of_a_turning_bus():
    """The origin of B goes round the common centre of mass, 2 m away."""
    rate = np.radians(2.0)  # rad/s
    host = Host("manipulator_plant", initial_angular_velocity__x=rate).run_mode()
    host.step(STEP)
    _, com_B = host.slave.balance.find_momentum(host.slave.model, host.slave.state)
    assert host.get("base_acceleration.z")[0] == pytest.approx(rate**2 * com_B[2], rel=2e-3)


def test_initial_attitude_turns_both_attitudes():
    q = np.array([0.5, 0.5, -0.5, 0.5])
    values = {f"initial_attitude__{axis}": float(value) for axis, value in zip("wxyz", q, strict=True)}
    host = Host("manipulator_plant", coarse_command_1=0.005, **values).run_mode()
    plain = Host("manipulator_plant", coarse_command_1=0.005).run_mode()
    for key in ("base_attitude", "payload_attitude"):
        expected = multiply(q, plain.slave.y[PLACE[key]])
        np.testing.assert_allclose(host.slave.y[PLACE[key]], expected, rtol=0.0, atol=1e-15)


def test_a_plant_that_vibrates_keeps_its_linear_model():
    """Default results are those of one linear model: nothing is renewed for motion below the distances."""
    host = Host("manipulator_plant").run_mode()
    model = host.slave.model
    host.set(base_force__x=10.0, base_torque__z=5.0)
    host.step(STEP, 50)
    assert host.slave.model is model
    assert model.convection is None
