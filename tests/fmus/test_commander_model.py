"""PointingCommander driven as a Python object: initial pose, motion, refusals, methods, state."""

import numpy as np
import pytest
from support.models import Host, slave_class

from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics, reachable
from ps_fmu.mechanism.kinematics import forward_kinematics
from ps_fmu.mechanism.parameters import load
from ps_fmu.slavekit.author.slave import ModelError, Refused

GEOMETRY = load().manipulator.geometry
RPY = ("roll", "pitch", "yaw")
H = 0.01  # s


def commander(target_deg=(0.0, 0.0, 0.0), **parameters):
    return Host("pointing_commander", **target(target_deg), **parameters).run_mode()


def target(angles_deg):
    return {f"target__{axis}": np.radians(angle) for axis, angle in zip(RPY, angles_deg, strict=True)}


def command(host):
    return host.slave.values("coarse_command")


def orientation(host):
    return host.slave.values("orientation_command")


def record(host, duration, h=H):
    """All outputs after each step, one row each."""
    rows = []
    for _ in range(round(duration / h)):
        host.step(h)
        rows.append(host.slave.y.copy())
    return np.array(rows)


def column(name):
    return slave_class("pointing_commander").layout.reference[name]


def test_it_starts_at_rest_at_the_initial_target():
    host = Host("pointing_commander", **target((8.5, 0.0, 0.0)))
    pose = inverse_kinematics(GEOMETRY, np.radians([8.5, 0.0, 0.0]))
    np.testing.assert_array_equal(command(host.run_mode()), pose.coarse_displacement)
    before = host.slave.y.copy()
    assert record(host, 1.0) == pytest.approx(np.tile(before, (100, 1)), abs=0.0)
    assert host.flag("reachable") and not host.flag("moving")
    np.testing.assert_array_equal(host.slave.values("platform_position"), pose.translation_B)
    assert host.get("residual")[0] < 3e-16 and host.get("time_to_go", "orientation_rate.roll") == [0.0, 0.0]


def test_a_target_set_in_initialisation_mode_is_the_initial_pose():
    host = Host("pointing_commander")
    host.set(target__yaw=0.1)
    assert host.get("orientation_command.yaw") == [0.1]
    host.run_mode().step(H)
    assert host.get("orientation_command.yaw") == [0.1] and not host.flag("moving")


def test_slew_is_smooth_and_ends_exactly_at_the_target():
    host = commander()
    host.set(**target((8.5, 0.0, 0.0)))
    rows = record(host, 30.0)
    time = H * np.arange(1, len(rows) + 1)
    roll = rows[:, column("orientation_command.roll")]
    rate = rows[:, column("orientation_rate.roll")]
    np.testing.assert_allclose(np.gradient(roll, H)[1:-1], rate[1:-1], atol=2e-8)
    assert rate.max() == pytest.approx(0.0125, rel=1e-6)
    # The fourth derivative of the commands is finite, 1.4e-4 m/s4 at most: no step in the third.
    commands = rows[:, :3]
    assert np.abs(np.diff(commands, 4, axis=0)).max() < 1.5e-4 * H**4 + 1e-15
    moving = rows[:, column("moving")].astype(bool)
    end = 35.0 / 16.0 * np.radians(8.5) / 0.0125  # s
    np.testing.assert_array_equal(moving, time < end)
    np.testing.assert_allclose(rows[moving, column("time_to_go")], end - time[moving], atol=1e-12)
    expected = inverse_kinematics(GEOMETRY, np.radians([8.5, 0.0, 0.0]))
    assert (~moving).sum() > 300
    for row in rows[~moving]:
        np.testing.assert_array_equal(row[:3], expected.coarse_displacement)
    np.testing.assert_array_equal(orientation(host), np.radians([8.5, 0.0, 0.0]))
    assert rows[:, column("residual")].max() < 5e-16
    assert rows[:, column("stroke_margin")].min() == pytest.approx(4.3847e-4, abs=1e-8)


def test_a_new_target_midway_goes_on_smoothly():
    host = commander()
    host.set(**target((8.5, 0.0, 0.0)))
    before = record(host, 11.0)
    host.set(**target((0.0, -5.0, 3.0)))
    rows = np.vstack([before, record(host, 60.0)])
    assert not host.flag("moving")
    np.testing.assert_array_equal(orientation(host), np.radians([0.0, -5.0, 3.0]))
    places = [column(f"orientation_command.{axis}") for axis in RPY]
    # Across the change as elsewhere: no step in position, rate, acceleration or jerk.
    fourth = np.abs(np.diff(rows[:, places], 4, axis=0)).max(axis=1) / H**4
    assert fourth.max() < 1e-3  # rad/s4; a step of 1 % of the largest jerk would show as 5e-4
    jerk = np.diff(rows[:, places], 3, axis=0) / H**3
    assert np.abs(np.diff(jerk[1090:1110], axis=0)).max() < 1e-5  # rad/s3


@pytest.mark.parametrize(
    ("angles_deg", "reason"),
    [
        (
            (9.98, 0.0, 0.0),
            "coarse leg 2 would need -22.9907 mm, 2.991 mm beyond its stroke of -20 to +20 mm",
        ),
        ((0.0, 0.0, 180.0), "no common point: fine leg 2 is 1.931 mm too short"),
    ],
)
def test_unreachable_target_keeps_the_last_good_command(angles_deg, reason):
    host = commander((1.0, 2.0, 3.0))
    good = command(host)
    host.set(**target(angles_deg))
    host.step(H, 5)
    assert not host.flag("reachable") and not host.flag("moving")
    np.testing.assert_array_equal(command(host), good)
    (text,) = host.messages().splitlines()
    assert "refused at t = 0 s" in text
    assert reason in text
    host.set(**target((1.0, 2.0, 4.0)))
    host.step(H, 3)
    assert host.flag("reachable") and host.flag("moving")


def test_unreachable_target_midway_lets_the_motion_end():
    host, plain = commander(), commander()
    for other in (host, plain):
        other.set(**target((8.5, 0.0, 0.0)))
        other.step(H, 1000)
    host.set(**target((20.0, 0.0, 0.0)))
    rows, expected = record(host, 20.0), record(plain, 20.0)
    assert not host.flag("reachable")
    rows[:, column("reachable")] = 1.0
    np.testing.assert_array_equal(rows, expected)
    # Back to the target of the motion in hand: accepted, nothing moves.
    host.set(**target((8.5, 0.0, 0.0)))
    host.step(H)
    assert host.flag("reachable") and not host.flag("moving")


def test_unreachable_path_between_reachable_poses_is_refused():
    """The workspace is not convex: between two corners of the stroke leg 2 would have to leave it."""
    corners = np.array([[-0.02, -0.02, 0.02], [0.02, 0.02, 0.02]])  # m
    lengths = GEOMETRY.nominal_lengths + np.hstack([corners, np.zeros((2, 3))])
    a, b = np.degrees(forward_kinematics(GEOMETRY, lengths).orientation)
    host = commander(a)
    host.set(**target(b))
    host.step(H)
    assert not host.flag("reachable") and not host.flag("moving")
    assert "on the way, coarse leg" in host.messages() and "the last one stays" in host.messages()
    np.testing.assert_array_equal(orientation(host), np.radians(a))


def test_a_path_is_refused_where_any_of_257_poses_is_out_of_reach():
    """Between poses near the edge of the workspace; then the path is shrunk until one pose is just out."""
    random = np.random.default_rng(3)
    strokes = 0.0199 * random.choice([-1.0, 1.0], (40, 2, 3))  # m
    strokes[:, :, 0] *= random.uniform(0.3, 1.0, (40, 2))
    lengths = GEOMETRY.nominal_lengths + np.pad(strokes, ((0, 0), (0, 0), (0, 3)))
    tau = np.linspace(0.0, 1.0, 257)
    covered = (35 * tau**4 - 84 * tau**5 + 70 * tau**6 - 20 * tau**7)[:, None]

    def is_within(a, b):
        return bool(reachable(GEOMETRY, inverse_kinematics(GEOMETRY, a + covered * (b - a))).all())

    def is_accepted(a, b):
        host = commander(np.degrees(a))
        host.set(**target(np.degrees(b)))
        host.step(H)
        return host.flag("reachable")

    edges = 0
    for a, b in forward_kinematics(GEOMETRY, lengths).orientation:
        expected = is_within(a, b)
        assert is_accepted(a, b) == expected
        if not expected and is_within(0.5 * a, 0.5 * b):
            inside, outside = 0.5, 1.0
            while outside - inside > 1e-6:
                middle = 0.5 * (inside + outside)
                inside, outside = (middle, outside) if is_within(middle * a, middle * b) else (inside, middle)
            assert is_accepted(inside * a, inside * b)
            assert not is_accepted(outside * a, outside * b)
            edges += 1
    assert edges > 5


def test_path_unreachable_in_motion_is_tried_again_at_rest():
    host = commander()
    host.set(**target((-4.2, 4.9, 2.5)))
    host.step(H, 1166)
    host.set(**target((-0.3, 4.6, 10.6)))
    host.step(H)
    assert not host.flag("reachable")
    assert "tried again when the present motion has ended" in host.messages()
    host.step(H, 1166)
    np.testing.assert_array_equal(orientation(host), np.radians([-4.2, 4.9, 2.5]))
    host.step(H, 2)
    assert host.flag("reachable") and host.flag("moving")
    host.step(H, 4000)
    np.testing.assert_array_equal(orientation(host), np.radians([-0.3, 4.6, 10.6]))
    assert host.messages().count("refused") == 1


def test_another_target_ends_the_wait():
    host = commander()
    host.set(**target((-4.2, 4.9, 2.5)))
    host.step(H, 1166)
    host.set(**target((-0.3, 4.6, 10.6)))
    host.step(H)
    host.set(**target((0.0, 0.0, 0.0)))
    host.step(H)
    assert host.flag("reachable")
    host.step(H, 5000)
    np.testing.assert_array_equal(orientation(host), np.zeros(3))


def test_unreachable_initial_target_starts_at_the_nominal_pose():
    host = commander((0.0, 30.0, 0.0))
    assert not host.flag("reachable")
    np.testing.assert_array_equal(command(host), np.zeros(3))
    assert "initial target (0, 30, 0) deg refused: coarse leg" in host.messages()
    host.set(**target((0.0, 3.0, 0.0)))
    host.step(H)
    assert host.flag("reachable") and host.flag("moving")


def test_legs_without_a_nominal_pose_are_refused():
    with pytest.raises(ModelError, match=r"geometry: no nominal pose: the three spheres of the fine legs"):
        Host("pointing_commander", fine_leg_1__base_joint__z=1e9).run_mode()


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_target_that_is_not_finite_is_refused_and_named(value):
    host = commander((1.0, 0.0, 0.0))
    with pytest.raises(Refused, match=r"target\.pitch"):
        host.set(target__pitch=value)
    host.step(H)
    assert host.flag("reachable")
    np.testing.assert_array_equal(orientation(host), np.radians([1.0, 0.0, 0.0]))


@pytest.mark.parametrize(("epsilon", "within"), [(1e-6, 3e-6), (1e-12, 5e-12)])
def test_algorithm_1_agrees_with_trilateration(epsilon, within):
    exact = commander()
    gradient = commander(use_algorithm_1=True, algorithm_1__epsilon=epsilon)
    for host in (exact, gradient):
        host.set(**target((6.0, -2.0, 1.0)))
    a, b = record(exact, 35.0, 0.1), record(gradient, 35.0, 0.1)
    np.testing.assert_allclose(b[:, :3], a[:, :3], rtol=0, atol=within)
    assert 0.0 < b[:, column("residual")].max() < epsilon
    places = [column(f"orientation_command.{axis}") for axis in RPY]
    np.testing.assert_array_equal(b[:, places], a[:, places])


def test_algorithm_1_that_does_not_converge_refuses_the_target():
    host = commander(use_algorithm_1=True, algorithm_1__max_iterations=20)
    host.set(**target((8.5, 0.0, 0.0)))
    host.step(H)
    assert not host.flag("reachable")
    assert "Algorithm 1 stopped after 20 iterations" in host.messages()


@pytest.mark.parametrize(
    ("parameters", "text"),
    [
        ({"max_rate": 0.0}, "max_rate: must be greater than 0"),
        ({"use_algorithm_1": True, "algorithm_1__mu": 0.9}, r"algorithm_1\.mu: .*2/lambda_max"),
        ({"algorithm_1__epsilon": 0.0}, r"algorithm_1\.epsilon: must be greater than 0"),
        ({"coarse_stroke__min": 0.01}, "coarse_stroke: min must be below 0"),
    ],
)
def test_impossible_parameter_is_named(parameters, text):
    host = Host("pointing_commander", **parameters)
    with pytest.raises(ModelError, match=text):
        host.run_mode()


def test_follow_commands_each_target_at_once():
    host = commander(follow=True)
    for roll in (0.1, 0.2, 0.3):
        host.set(**target((roll, 0.0, 0.0)))
        host.step(H)
        np.testing.assert_array_equal(orientation(host), np.radians([roll, 0.0, 0.0]))
    assert not host.flag("moving") and host.flag("reachable")


def test_follow_out_of_reach_is_said_once_and_ends():
    host = commander(follow=True)
    for roll in (8.5, 8.6, 8.8, 9.0, 9.1, 8.6):
        host.set(**target((roll, 0.0, 0.0)))
        host.step(H)
    assert host.messages().count("refused") == 1
    assert host.flag("reachable")
    np.testing.assert_array_equal(orientation(host), np.radians([8.6, 0.0, 0.0]))


@pytest.mark.parametrize("roll", [8.5, 20.0])
def test_a_target_that_varies_by_rounding_is_one_target(roll):
    """As from hosts that interpolate their inputs: same motion, one warning."""
    plain, noisy = commander(), commander()
    for k in range(3000):
        noise = 1e-16 * (k % 3)
        noisy.set(target__roll=np.radians(roll) + noise)
        if k == 0:
            plain.set(target__roll=np.radians(roll))
        plain.step(H)
        noisy.step(H)
        np.testing.assert_array_equal(noisy.slave.y, plain.slave.y)
    assert noisy.messages() == plain.messages()


def test_geometry_is_that_of_the_parameters():
    """A longer stroke reaches what the identified one does not."""
    host = commander((10.5, 0.0, 0.0), coarse_stroke__min=-0.025, coarse_stroke__max=0.025)
    assert host.flag("reachable")
    np.testing.assert_array_equal(orientation(host), np.radians([10.5, 0.0, 0.0]))


def test_experiment_that_starts_before_zero():
    slave = slave_class("pointing_commander")(instance_name="early")
    slave.setup_experiment(-5.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    assert slave.do_step(-5.0, H)
    assert not slave.value("moving") and slave.value("time_to_go") == 0.0


def test_commands_in_steps_of_an_encoder():
    """Whole steps, half a step off at most, from the start on; the commanded orientation is that of the exact ones."""
    step = 1e-5  # m
    exact, coarse = (commander((0.5, 0.0, 0.2), command_resolution=r) for r in (0.0, step))
    np.testing.assert_array_equal(command(coarse), np.rint(command(exact) / step) * step)
    for host in (exact, coarse):
        host.set(**target((1.0, 0.5, 0.0)))
    rows, stepped = record(exact, 12.0, 0.1), record(coarse, 12.0, 0.1)
    np.testing.assert_array_equal(stepped[:, :3], np.rint(rows[:, :3] / step) * step)
    np.testing.assert_array_equal(stepped[:, 3:], rows[:, 3:])
    assert np.abs(stepped[:, :3] - rows[:, :3]).max() > 0.4 * step
