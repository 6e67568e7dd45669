"""ManipulatorPlant in motion: against a nonlinear multibody program, and what slews, swings and turns must keep."""

import numpy as np
import pytest
from support.claims import verify_claim
from support.host import unpack
from support.mechanics import to_rotation_matrix
from support.models import Host
from support.slew_cases import CASES, EVERY, STEP, load_reference
from support.twins import InFmpy

from ps_fmu.mechanism.compiled import N_MOVING_INPUTS
from ps_fmu.mechanism.rotations import from_rotation_vector, multiply
from ps_fmu.mechanism.signals import N_OUTPUTS, output_slices
from ps_fmu.mechanism.stepping import Memory
from ps_fmu.slavekit.author.slave import ModelError, Refused

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

    def run(case, wrench, step=FINE_STEP, **values):
        one = InFmpy(folder, "plant")
        given = {name.replace("__", "."): value for name, value in {**case.start_values, **values}.items()}
        given["servo.rate_limit"] = 1.0  # m/s: the command moves as the reference of the multibody program does
        one.set(given)
        one.initialise()
        slave, place = one.fmu, {name: variable.valueReference for name, variable in one.variables.items()}
        load, outputs, rows = [place[name] for name in WRENCH], list(range(PLACE["payload_attitude"].stop)), []
        command, parts = [place[name] for name in COMMAND], round(STEP / step)
        reference = np.zeros(3)
        for k in range(round(case.duration / STEP) + 1):
            if k % EVERY == 0:
                rows.append(slave.getReal(outputs))
            slave.setReal(load, wrench(k * STEP).tolist())
            limit = case.parameters.servo.rate_limit * STEP
            way = np.clip(case.command - reference, -limit, limit)
            for part in range(parts):
                slave.setReal(command, (reference + way * (part + 1) / parts).tolist())
                slave.doStep(k * STEP + part * step, step)
            reference = reference + way
        one.end()
        return np.array(rows)

    return run


@pytest.mark.parametrize(("step", "payload"), [(FINE_STEP, 2e-8), (STEP, 6e-8)])  # s, rad
@pytest.mark.parametrize("name", CASES)
def test_plant_moves_as_the_multibody_program(simulate, name, step, payload):
    """README.md of the FMU has what is found."""
    reference, rows = load_reference()[name], simulate(CASES[name], CASES[name].wrench, step)
    for key, limit in (("base_attitude", 1e-8), ("payload_attitude", payload)):  # rad
        assert np.abs(turn_between(reference[key], rows[:, PLACE[key]])).max() < limit
    off = []
    for key in ("fine_displacement", "base_acceleration"):
        wanted = reference[key][1:]
        off.append(np.abs(rows[1:, PLACE[key]] - wanted).max() / np.abs(wanted).max())
    verify_claim(
        "model.fast_slews",
        claim="Motion of bus, payload and fine legs in fast slews",
        where="`ps-fmu run slew`, `pointing`: all signals",
        reference="nonlinear multibody program (Pinocchio); attitudes are within 6e-8 rad",
        error=off,
        bound=1e-4,
        unit="of the largest value",
    )


def test_comparison_sees_the_convective_forces(simulate):
    """Were the plant linear all the way, the same run would be off by a millirad."""
    far = {"relinearisation_distance": 1.0, "relinearisation_speed": 1.0, "relinearisation_angle": 0.1}
    rows, reference = simulate(FAST, FAST.wrench, **far), load_reference()["8.5 deg in 0.6 s"]
    assert np.abs(turn_between(reference["payload_attitude"], rows[:, PLACE["payload_attitude"]])).max() > 1e-3


@pytest.mark.parametrize("start", [{}, {"base": "prescribed"}, {"initial_angular_velocity.x": 0.01}])
def test_no_step_enters_python(built_fmus, tmp_path, start):
    """Slews, a command beyond the stroke, steps that change, states that are set: from the first step on."""
    one, time = InFmpy(unpack(built_fmus / "ManipulatorPlant.fmu", tmp_path / "fmu"), "plant"), 0.0
    one.set(start)
    one.initialise()
    random = np.random.default_rng(0)
    for k in range(900):
        if k % 300 == 0:
            one.set({COMMAND[0]: 5e-3 * (k // 300), COMMAND[1]: 0.03 * (k == 600)})
        if k == 450:
            one.restore(one.state())
        h = float(random.choice([1e-6, 1e-4, 1e-3, 2e-3])) if k % 20 == 0 else 1e-3  # s
        one.step(time, h)
        time += h
    assert one.steps() == (900, 0)
    one.end()


def kept(slave):
    """What the plant keeps from step to step, by name."""
    return Memory.from_buffer(slave.memory)


def find_momentum(slave):
    """Linear momentum and angular momentum about the centre of mass, (3,) each, and the centre of mass in B, (3,)."""
    mechanism = slave.step.mechanism
    x = slave.x[: mechanism.n_states]
    point = mechanism.evaluate(kept(slave).place, x, np.zeros(N_MOVING_INPUTS))
    momentum, _, com_B = mechanism.find_momentum(point, x)
    return momentum[:3], momentum[3:] - np.cross(com_B, momentum[:3]), com_B


def find_centre_of_mass(slave):
    """In inertial axes from where the origin of B was at the start, (3,) m."""
    _, _, com_B = find_momentum(slave)
    return to_rotation_matrix(slave.y[PLACE["base_attitude"]]) @ (slave.y[PLACE["base_position"]] + com_B)


@pytest.mark.parametrize(
    ("name", "shift"),
    [
        ("8.5 deg in 0.6 s", 5e-5),
        ("8.5 deg in 0.6 s, bus of 60 kg", 5e-3),
        ("3, 5, -8 deg in 0.7 s, bus of 60 kg", 3e-3),
    ],
)
def test_slews_to_and_fro_keep_momentum_and_centre_of_mass(name, shift):
    """That of the payload alone is up to 3 N.s."""
    case = CASES[name]
    host = Host("manipulator_plant", **case.start_values).run_mode()
    slave, moved = host.slave, 0.0
    first = find_centre_of_mass(slave)
    for k in range(6):
        slave.view("coarse_command")[:] = case.command * (1 - k % 2)
        for _ in range(8):
            host.step(STEP, 100)
            linear, angular, _ = find_momentum(slave)
            assert np.abs(np.concatenate([linear, angular])).max() < 5e-8  # N.s, N.m.s: between two corrections
            assert np.abs(find_centre_of_mass(slave) - first).max() < 1e-10  # m
            moved = max(moved, np.abs(slave.y[PLACE["base_position"]]).max())
    assert moved > shift  # m
    assert np.abs(np.concatenate([linear, angular])).max() < 4e-9  # N.s, N.m.s


def test_forces_move_momentum_and_centre_of_mass_as_they_must():
    """A force on the bus of 60 kg in inertial axes while it slews and turns: its impulse, and the integral of that."""
    case = CASES["3, 5, -8 deg in 0.7 s, bus of 60 kg"]
    host = Host("manipulator_plant", **case.start_values).run_mode()
    slave = host.slave
    slave.view("coarse_command")[:] = case.command
    first, force = find_centre_of_mass(slave), np.array([0.6, -0.4, 0.8])  # N
    mass = case.parameters.bus.mass + kept(slave).locked[0]
    for _ in range(5000):
        half = slave.y[PLACE["base_angular_velocity"]] * (0.5 * FINE_STEP)
        q = multiply(slave.y[PLACE["base_attitude"]], from_rotation_vector(half))
        slave.view("base_force")[:] = to_rotation_matrix(q / np.linalg.norm(q)).T @ force
        host.step(FINE_STEP)
    momentum_B, _, _ = find_momentum(slave)
    found = to_rotation_matrix(slave.y[PLACE["base_attitude"]]) @ momentum_B
    np.testing.assert_allclose(found, 0.5 * force, rtol=0.0, atol=1e-6)  # N.s
    shift = 0.5 * force / mass * 0.5**2
    np.testing.assert_allclose(find_centre_of_mass(slave) - first, shift, rtol=0.0, atol=1e-8)  # m
    assert np.abs(shift).max() > 1e-3


@pytest.mark.parametrize("step", [FINE_STEP, STEP])
@pytest.mark.parametrize("name", ["8.5 deg in 0.6 s", "bus at 1 deg/s, yaw 10 deg in 0.5 s"])
def test_outputs_do_not_jump_where_motion_begins_and_ends(name, step):
    """Outputs at rest are linear; those of the mechanism itself at the same state are the same there."""
    case = CASES[name]
    host = Host("manipulator_plant", **case.start_values, **{f"fine_leg_{i}__damping": 2e3 for i in (1, 2, 3)})
    slave = host.run_mode().slave
    slave.view("coarse_command")[:] = case.command
    was, changes = kept(slave).moving, 0
    for _ in range(round(3.0 / step)):
        host.step(step)
        if kept(slave).moving != was:
            was, changes = kept(slave).moving, changes + 1
            before = slave.y.copy()
            slave.do_step(slave.time, 1e-9)
            for key, limit in (("orientation", 1e-8), ("payload_attitude", 1e-8), ("base_acceleration", 1e-6)):
                np.testing.assert_allclose(slave.y[PLACE[key]], before[PLACE[key]], rtol=0.0, atol=limit, err_msg=key)
            slave.do_step(slave.time, step - 1e-9)
            host.count += 1
    assert changes >= 2 or any(case.turn_deg_s)


def test_after_a_slew_the_model_is_the_one_of_the_pose_at_rest():
    host = Host("manipulator_plant", servo__rate_limit=0.05, **{f"fine_leg_{i}__damping": 2e3 for i in (1, 2, 3)})
    host.run_mode().set(coarse_command_2=2e-4)
    host.step(STEP, 3000)
    there = Host("manipulator_plant", coarse_command_2=2e-4).run_mode()
    there.step(STEP)
    assert not kept(host.slave).moving
    assert kept(host.slave).present.coarse[:] == kept(there.slave).present.coarse[:]
    assert kept(host.slave).present.fine[:] == kept(there.slave).present.fine[:] == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("step", [2e-3, 1e-2, 0.1, 2.0])
def test_a_slew_is_the_same_in_steps_of_any_size(step):
    """Commands and loads are held: at the ends of long steps the plant is where short ones lead."""
    start = {"servo__rate_limit": 0.02, "base_force__x": 2.0, "base_torque__z": -1.0}
    ends = []
    for each in (1e-3, step):
        host = Host("manipulator_plant", **start).run_mode()
        host.set(coarse_command_1=6e-3, coarse_command_3=-2e-3)
        for _ in range(2):
            host.step(each, round(2.0 / each))
        ends.append(host.slave.y.copy())
    for key, limit in (("payload_attitude", 1e-6), ("fine_displacement", 5e-7), ("fine_velocity", 5e-6)):
        np.testing.assert_allclose(ends[1][PLACE[key]], ends[0][PLACE[key]], rtol=0.0, atol=limit, err_msg=key)


def test_steps_that_change_all_the_time_lead_to_the_same_place():
    random, ends = np.random.default_rng(3), []
    for changing in (False, True):
        host = Host("manipulator_plant", servo__rate_limit=0.02).run_mode()
        host.set(coarse_command_1=4e-3)
        left, time = 200, 0.0
        while left > 0:
            n = min(left, int(random.integers(1, 8))) if changing else 1
            host.slave.do_step(time, n * 1e-3)
            time, left = time + n * 1e-3, left - n
        ends.append(host.slave.y.copy())
    np.testing.assert_allclose(
        ends[1][PLACE["payload_attitude"]], ends[0][PLACE["payload_attitude"]], rtol=0.0, atol=2e-7
    )


@pytest.mark.parametrize("steps", [5, 400, 1300])
def test_a_state_in_a_slew_goes_on_with_the_same_bits(steps):
    """In another instance, whose matrices are made again; parts of a next model included."""
    host = move(FAST, steps)
    other = Host("manipulator_plant", **FAST.start_values).run_mode()
    other.restore(host.save(), host.count)
    for each in (host, other):
        each.slave.view("coarse_command")[:] = 0.5 * FAST.command
        each.step(FINE_STEP, 300)
    np.testing.assert_array_equal(other.slave._buffer.data, host.slave._buffer.data)


@pytest.mark.parametrize(("name", "value"), [("parts", 1e300), ("parts", -1e19), ("unused", 1e300)])
def test_a_made_up_state_in_a_slew_goes_on_to_the_same_place(name, value):
    """The next linear model is finished, whatever number of its parts the state states."""
    found = []
    for made_up in (False, True):
        host = Host("manipulator_plant").run_mode()
        host.set(coarse_command_1=4e-3)
        while kept(host.slave).parts == 0.0:
            host.step(1e-3)
        if made_up:
            setattr(kept(host.slave), name, value)
            host.restore(host.save(), host.count)
        host.step(1e-3, 600)
        assert kept(host.slave).parts < 1e3
        found.append(host.slave.y[:N_OUTPUTS].copy())
    np.testing.assert_allclose(found[1], found[0], rtol=0.0, atol=1e-7)


def test_a_made_up_state_of_rest_without_a_map_moves_on():
    used, new = (Host("manipulator_plant", base_torque__x=1.0).run_mode() for _ in range(2))
    used.step(1e-3, 20)
    kept(used.slave).present.rest = 0.0
    new.restore(used.save(), used.count)
    kept(used.slave).present.rest = 1.0
    for host in (used, new):
        host.step(1e-3, 20)
    turned = PLACE["base_rotation"]
    assert np.abs(used.slave.y[turned]).max() > 5e-8
    np.testing.assert_allclose(new.slave.y[turned], used.slave.y[turned], rtol=1e-4, atol=1e-12)


def move(case, steps):
    """The slave as a Python object, in the motion of a case that nothing disturbs."""
    host = Host("manipulator_plant", **case.start_values).run_mode()
    host.slave.view("coarse_command")[:] = case.command
    host.step(FINE_STEP, steps)
    return host


def test_a_step_to_numbers_that_are_not_finite_changes_nothing():
    host = move(FAST, 1000)
    data = host.slave._buffer.data.copy()
    host.slave.view("payload_torque")[:] = 1e300
    data[host.slave.layout.u] = host.slave.u
    with pytest.raises((ModelError, Refused), match="singular pose"):
        host.step(FINE_STEP)
    np.testing.assert_array_equal(host.slave._buffer.data, data)


def test_a_body_that_turns_freely_keeps_its_rate_and_its_quaternion_unit():
    """About a principal axis; the small-angle output goes on as the integral of the rate."""
    rate = 0.03  # rad/s
    heavy = {f"bus__inertia__{axis}{axis}": 1e6 for axis in "xyz"}  # kg.m2
    host = Host("manipulator_plant", initial_angular_velocity__z=rate, **heavy).run_mode()
    host.step(1e-2, 300)
    q = host.slave.y[PLACE["base_attitude"]]
    assert abs(np.linalg.norm(q) - 1.0) < 1e-15
    np.testing.assert_allclose(q, from_rotation_vector(np.array([0.0, 0.0, rate * 3.0])), rtol=0.0, atol=1e-6)
    assert host.get("base_rotation.z")[0] == pytest.approx(rate * 3.0, rel=1e-6)


def test_centripetal_acceleration_of_a_turning_bus():
    """The origin of B goes round the common centre of mass, 2 m away."""
    rate = np.radians(2.0)  # rad/s
    host = Host("manipulator_plant", initial_angular_velocity__x=rate).run_mode()
    host.step(STEP)
    _, _, com_B = find_momentum(host.slave)
    assert host.get("base_acceleration.z")[0] == pytest.approx(rate**2 * com_B[2], rel=2e-3)


def test_initial_attitude_turns_both_attitudes():
    q = np.array([0.5, 0.5, -0.5, 0.5])
    values = {f"initial_attitude__{axis}": float(value) for axis, value in zip("wxyz", q, strict=True)}
    host = Host("manipulator_plant", coarse_command_1=0.005, **values).run_mode()
    plain = Host("manipulator_plant", coarse_command_1=0.005).run_mode()
    for key in ("base_attitude", "payload_attitude"):
        expected = multiply(q, plain.slave.y[PLACE[key]])
        np.testing.assert_allclose(host.slave.y[PLACE[key]], expected, rtol=0.0, atol=1e-15)


def test_a_plant_that_vibrates_stays_linear():
    """Default results are those of one linear model: nothing moves below the distances."""
    host = Host("manipulator_plant").run_mode()
    host.set(base_force__x=10.0, base_torque__z=5.0)
    host.step(STEP, 50)
    assert not kept(host.slave).moving
