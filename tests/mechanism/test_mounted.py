"""The manipulator on a base whose motion is prescribed: against its own bus, momentum, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from support.hub import Hub, LockedMass, Mounted, cube, fly, push
from support.mechanics import PAPER, rigid

from ps_fmu.mechanism.compiled import N_MOVING_INPUTS, Place
from ps_fmu.mechanism.dynamics import bus_mass
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.rotations import skew
from ps_fmu.mechanism.signals import N_EXTERNAL, N_INPUTS, N_OUTPUTS, output_slices, servo_slices

SLOPE = np.array([0.004, -0.003, 0.002])  # m
BUS = cube(60.0)
OWN = replace(Plant.from_parameters(PAPER), bus=BUS)
MODEL = OWN.linearise(SLOPE)
SHAKING = 1e-3 * np.random.default_rng(4).normal(size=N_EXTERNAL)  # N, N.m; on fine legs and payload, at 30 Hz
SHAKING[3:9] = 0.0
PLACE = output_slices()


def mount() -> Mounted:
    return Mounted(**{f"coarse_command_{i}": each for i, each in enumerate(SLOPE.tolist(), 1)})


def shake(t: float) -> np.ndarray:
    """Forces (18,) at a time, s."""
    return SHAKING * np.sin(60.0 * np.pi * t)


def test_locked_mass_is_what_the_mechanism_adds_to_the_base() -> None:
    dynamics = MODEL.dynamics
    q_b = dynamics.slices["q_b"]
    added = dynamics.M[q_b, q_b] - bus_mass(BUS)
    for locked in (LockedMass.of(dynamics), mount().locked):
        np.testing.assert_allclose(locked.matrix, added, atol=1e-13)


def test_locked_mass_of_a_payload_on_light_legs_is_the_payload() -> None:
    def light(leg):
        lower, upper = (replace(part, mass=0.0, radial_inertia=0.0) for part in (leg.lower, leg.upper))
        return replace(leg, lower=lower, upper=upper)

    manipulator = PAPER.manipulator
    coarse, fine = (tuple(map(light, legs)) for legs in (manipulator.coarse_legs, manipulator.fine_legs))
    parameters = replace(rigid(), manipulator=replace(rigid().manipulator, coarse_legs=coarse, fine_legs=fine))
    dynamics = Plant.from_parameters(parameters).linearise(SLOPE).dynamics
    locked = LockedMass.of(dynamics)
    R, payload = dynamics.pose.rotation_BP, parameters.payload
    com_B = dynamics.pose.translation_B + R @ payload.com_P
    steiner = payload.mass * (com_B @ com_B * np.eye(3) - np.outer(com_B, com_B))
    assert locked.mass == pytest.approx(payload.mass, rel=1e-14)
    np.testing.assert_allclose(locked.com_B, com_B, atol=1e-15)
    np.testing.assert_allclose(locked.inertia_B, R @ payload.inertia_P @ R.T + steiner, atol=1e-14)


def own_bus(h: float, n: int) -> np.ndarray:
    """Payload rotation on its own bus, (n, 3), rad, forces held over each step."""
    step, x, rows = MODEL.step_map(h), OWN.initial_state(MODEL), []
    for k in range(n):
        u = np.zeros(N_INPUTS)
        u[:N_EXTERNAL], u[-1] = shake((k + 0.5) * h), 1.0
        u[3:9] = push((k + 0.5) * h)
        result = step @ np.concatenate([x, u])
        x = result[N_OUTPUTS:]
        rows.append(result[PLACE["payload_rotation"]])
    return np.array(rows)


def beside_a_hub(h: float, n: int) -> tuple[np.ndarray, np.ndarray, Mounted, np.ndarray, np.ndarray]:
    """Rotation of the payload, (n, 3), rad; impulse on the hub (6,); the plant; motion of the base (n, 9).

    And momentum of the plant relative to the base (n + 1, 6).
    """
    mounted, hub, motions, rotation, taken = mount(), Hub(BUS), [], [], [np.zeros(6)]

    def make_step(motion):
        y = mounted.step(h, motion, shake((len(motions) + 0.5) * h))
        rotation.append(y[PLACE["payload_rotation"]])
        motions.append(motion)
        taken.append(relative_momentum(mounted))
        return y[Mounted.REACTION]

    fly(make_step, lambda: mounted.locked, hub, h, n)
    return np.array(rotation), hub.impulse, mounted, np.array(motions), np.array(taken)


def relative_momentum(mounted: Mounted) -> np.ndarray:
    """(6,): of a plant at rest, relative to its base, N.s and N.m.s."""
    of, d = mounted.n, MODEL.dynamics
    x, rates, others = mounted.slave.x[: 2 * of + 9], np.zeros(d.n), d.active.copy()
    others[d.slices["q_b"]] = False
    rates[np.r_[0:9, d.n - (of - 9) : d.n]] = x[of : 2 * of]  # without places of the bus's modes
    return d.M[d.slices["q_b"]] @ (rates * others) + d.m_c[d.slices["q_b"]] @ x[servo_slices(of)[1]]


def test_payload_moves_as_on_its_own_bus_to_second_order_in_the_step() -> None:
    """At 2e-4 s on a hub of 60 kg the error is below 3e-4 of the motion."""
    errors = []
    for h in (2e-4, 1e-4):
        truth = own_bus(h, round(0.15 / h))
        error = np.abs(beside_a_hub(h, len(truth))[0] - truth).max(axis=0)
        errors.append(error / np.abs(truth).max(axis=0))
    assert errors[0].max() < 3e-4
    assert np.all((errors[0] / errors[1] > 3.5) & (errors[0] / errors[1] < 4.5))


def test_no_momentum_is_lost_or_made() -> None:
    """Hub and relative motion have all that came from outside: each reaction leads to the end of the step after it."""
    h, n = 1e-4, 1000
    _, given, mounted, motion, taken = beside_a_hub(h, n)
    given += h * mounted.slave.y[Mounted.REACTION]  # the host has not yet taken it
    last = shake((n - 0.5) * h)
    mounted.step(h, motion[-1], last)
    P = relative_momentum(mounted)
    outside = h * sum(push((k + 0.5) * h) for k in range(n))
    outside += h * payload_wrench_on_base() @ (sum(shake((k + 0.5) * h)[12:18] for k in range(n)) + last[12:18])
    means = [*(0.5 * (taken[1:] + taken[:-1])), 1.5 * taken[-1] - 0.5 * taken[-2]]  # the last one is expected
    for turn, mean in zip([*motion[:, 6:], motion[-1, 6:]], means, strict=True):  # axes of B turn
        outside -= h * np.concatenate([np.cross(turn, mean[:3]), np.cross(turn, mean[3:])])
    assert np.abs(P).max() > 1e-5
    np.testing.assert_allclose(given + P, outside, rtol=0.0, atol=1e-11)


@pytest.mark.parametrize("h", [1e-3, 1e-2])
def test_no_momentum_is_lost_or_made_in_slews(h: float) -> None:
    """From rest to motion and back: the sum of all impulses is what the mechanism has taken, up to rounding.

    The momentum in motion is that of the mechanism where it is, at rest that about a pose.  A step in which the linear
    model is replaced differs a little from what was expected of it.
    """
    mounted, given, phases, largest = Mounted(), np.zeros(6), [0.0], 0.0
    mechanism, command, pose = mounted.slave.step.mechanism, mounted.slave.u[27:], np.array([4e-3, -3e-3, 2e-3])  # m

    def find_momentum(translation, rotation):
        x, pose = mounted.slave.x[: mechanism.n_states], (translation, rotation)
        place = Place.of(*pose, pose, np.array([1.0, 0.0, 0.0, 0.0]))
        return mechanism.find_momentum(mechanism.evaluate(place, x, np.zeros(N_MOVING_INPUTS)), x)[0]

    for k in range(round(9.0 / h)):
        before, command[:] = command.copy(), pose * (1.0 < k * h < 3.0)
        centre = bytes(mounted.memory.present)
        y = mounted.step(h, np.zeros(9))
        phases.append(mounted.memory.moving)
        if phases[-2:] == [1.0, 1.0] and np.array_equal(command, before):
            place = mounted.memory.place
            taken = find_momentum(np.array(place.translation), np.reshape(place.rotation, (3, 3)))
            largest = max(largest, np.abs(taken).max())
            assert np.abs(given + taken).max() < (1e-13 if bytes(mounted.memory.present) == centre else 1e-8)
        given = given + h * y[Mounted.REACTION]
    mounted.step(h, np.zeros(9))
    assert 1.0 in phases and phases[-1] == 0.0
    assert largest > 0.01
    geometry, centre = OWN.manipulator.geometry, mounted.memory.present
    lengths = geometry.nominal_lengths + np.array([*centre.coarse, *centre.fine])
    settled = find_momentum(*mechanism.find_place(lengths, geometry.nominal_translation_B, np.eye(3)))
    assert np.abs(given + settled).max() < 1e-12


def payload_wrench_on_base() -> np.ndarray:
    """(6, 6): a wrench in P at its origin as one in B at its origin."""
    pose = MODEL.dynamics.pose
    R = pose.rotation_BP
    return np.block([[R, np.zeros((3, 3))], [skew(pose.translation_B) @ R, R]])


def test_forces_on_the_hosts_hub_are_the_hosts() -> None:
    found = []
    for load in (0.0, 10.0):
        forces = SHAKING.copy()
        forces[3:9] = load
        mounted = mount()
        found.append(np.array([mounted.step(1e-3, np.zeros(9), forces) for _ in range(3)]))
    np.testing.assert_array_equal(*found)


def test_a_base_that_turns_steadily_carries_the_payload_along() -> None:
    mounted, turn = mount(), np.array([1e-3, -2e-3, 3e-3])  # rad/s
    for _ in range(100):
        y = mounted.step(1e-3, np.append(np.zeros(6), turn))
    turned = 0.1 * turn
    np.testing.assert_allclose(y[PLACE["base_rotation"]], turned, rtol=1e-12)
    rotation_BP = MODEL.dynamics.pose.rotation_BP
    np.testing.assert_allclose(y[PLACE["payload_rotation"]], rotation_BP.T @ turned, rtol=1e-9)
    np.testing.assert_allclose(y[PLACE["base_angular_velocity"]], turn, rtol=1e-15)
    np.testing.assert_allclose(y[Mounted.REACTION], 0.0, atol=1e-12)
