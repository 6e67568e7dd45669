"""The manipulator on a base whose motion is prescribed: against its own bus, momentum, closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from support.hub import Hub, cube, fly, push
from support.mechanics import PAPER, rigid

from ps_fmu.mechanism.dynamics import bus_mass
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.mounted import (
    N_HOST_OUTPUTS,
    N_MOTION,
    HostedModel,
    LockedMass,
    relative_momentum,
    stand_in_bus,
)
from ps_fmu.mechanism.rotations import skew
from ps_fmu.mechanism.signals import N_EXTERNAL, N_INPUTS, N_OUTPUTS, output_slices

SLOPE = np.array([0.004, -0.003, 0.002])  # m
BUS = cube(60.0)
OWN = replace(Plant.from_parameters(PAPER), bus=BUS)
PRESCRIBED = replace(OWN, bus=stand_in_bus(BUS))
MODEL = HostedModel(PRESCRIBED.linearise(SLOPE), True)
REACTION = slice(N_OUTPUTS, N_OUTPUTS + 6)
STATES = slice(N_OUTPUTS + N_HOST_OUTPUTS, None)
MOTION = slice(N_EXTERNAL, N_EXTERNAL + N_MOTION)
SHAKING = 1e-3 * np.random.default_rng(4).normal(size=N_EXTERNAL)  # N, N.m; on fine legs and payload, at 30 Hz
SHAKING[3:9] = 0.0


def inputs(size: int, t: float) -> np.ndarray:
    u = np.zeros(size)
    u[:N_EXTERNAL] = SHAKING * np.sin(60.0 * np.pi * t)
    u[-1] = 1.0
    return u


def test_locked_mass_is_what_the_mechanism_adds_to_the_base() -> None:
    dynamics = OWN.linearise(SLOPE).dynamics
    q_b = dynamics.slices["q_b"]
    added = dynamics.M[q_b, q_b] - bus_mass(BUS)
    np.testing.assert_allclose(LockedMass.of(dynamics).matrix, added, atol=1e-13)


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
    model = OWN.linearise(SLOPE)
    step, x, rows = model.step_map(h), OWN.initial_state(model), []
    for k in range(n):
        u = inputs(N_INPUTS, (k + 0.5) * h)
        u[3:9] = push((k + 0.5) * h)
        result = step @ np.concatenate([x, u])
        x = result[N_OUTPUTS:]
        rows.append(result[output_slices()["payload_rotation"]])
    return np.array(rows)


def beside_a_hub(h: float, n: int) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Rotation of the payload, (n, 3), rad; impulse on the hub (6,); the state; motion in the last two steps (2, 9)."""
    step, x, hub = MODEL.step_map(h), PRESCRIBED.initial_state(MODEL.model), Hub(BUS)
    motions, rotation = [], []

    def make_step(motion):
        nonlocal x
        u = inputs(N_INPUTS + N_MOTION, (len(motions) + 0.5) * h)
        u[MOTION] = motion
        result = step @ np.concatenate([x, u])
        x = result[STATES]
        rotation.append(result[output_slices()["payload_rotation"]])
        motions.append(motion)
        return result[REACTION]

    fly(make_step, lambda: MODEL.locked, hub, h, n)
    return np.array(rotation), hub.impulse, x, np.array(motions[-2:])


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
    """Hub and relative motion have all that came from outside, but for the last change of the inputs."""
    h, n = 1e-4, 1000
    _, given, x, motion = beside_a_hub(h, n)
    P, step = relative_momentum(MODEL.model), MODEL.step_map(h)
    both, columns = given + P @ x, MODEL.model.n_states + np.arange(N_INPUTS + N_MOTION)
    last, before = (inputs(N_INPUTS + N_MOTION, (k - 0.5) * h) for k in (n, n - 1))
    last[MOTION], before[MOTION] = motion[1], motion[0]
    unknown = P @ step[STATES, columns] @ (last - before)
    outside = h * sum(push((k + 0.5) * h) for k in range(n)) + by_payload_wrench(h, n)
    late = h * payload_wrench_on_base() @ (last - before)[12:18]
    assert np.abs(unknown).max() < 1e-4 * np.abs(P @ x).max()
    np.testing.assert_allclose(both - outside, unknown - late, rtol=0.0, atol=1e-11)


def payload_wrench_on_base() -> np.ndarray:
    """(6, 6): a wrench in P at its origin as one in B at its origin."""
    pose = MODEL.model.dynamics.pose
    R = pose.rotation_BP
    return np.block([[R, np.zeros((3, 3))], [skew(pose.translation_B) @ R, R]])


def by_payload_wrench(h: float, n: int) -> np.ndarray:
    """Impulse (6,) of the wrench on the payload in n steps."""
    return h * payload_wrench_on_base() @ sum(inputs(N_INPUTS, (k + 0.5) * h)[12:18] for k in range(n))


def test_forces_on_the_hosts_hub_are_the_hosts() -> None:
    step = MODEL.step_map(1e-3)
    columns = MODEL.model.n_states + np.arange(3, 9)
    assert not step[:, columns].any()


def test_a_base_that_turns_steadily_carries_the_payload_along() -> None:
    step, x = MODEL.step_map(1e-3), PRESCRIBED.initial_state(MODEL.model)
    u = inputs(N_INPUTS + N_MOTION, 0.0)
    u[MOTION] = [0.0] * 6 + [1e-3, -2e-3, 3e-3]
    for _ in range(100):
        result = step @ np.concatenate([x, u])
        x = result[STATES]
    place = output_slices()
    turned = 0.1 * u[MOTION][6:]
    np.testing.assert_allclose(result[place["base_rotation"]], turned, rtol=1e-12)
    rotation_BP = MODEL.model.dynamics.pose.rotation_BP
    np.testing.assert_allclose(result[place["payload_rotation"]], rotation_BP.T @ turned, rtol=1e-9)
    np.testing.assert_allclose(result[place["base_angular_velocity"]], u[MOTION][6:], rtol=1e-15)
    np.testing.assert_allclose(result[REACTION], 0.0, atol=1e-12)


def test_on_its_own_bus_the_maps_are_the_plants() -> None:
    model = OWN.linearise(SLOPE)
    step, hosted = model.step_map(1e-3), HostedModel(model, False)
    wide = np.delete(hosted.step_map(1e-3), np.s_[N_OUTPUTS : N_OUTPUTS + N_HOST_OUTPUTS], axis=0)
    columns = model.n_states + np.arange(N_EXTERNAL, N_EXTERNAL + N_MOTION)
    assert np.array_equal(np.delete(wide, columns, axis=1), step)
    assert not wide[:, columns].any()
    numbers = hosted.output_map()[N_OUTPUTS + 6 : N_OUTPUTS + N_HOST_OUTPUTS, -1]
    assert np.array_equal(numbers, hosted.locked.numbers)
