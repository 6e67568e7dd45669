"""The loop as the master steps it: against a loop over the models' steps, and against continuous time."""

import numpy as np
import pytest

from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.signals import N_INPUTS, N_OUTPUTS, output_slices
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled import from_base_sampled
from ps_fmu.theory.stepped import step_loop
from ps_fmu.theory.transmissibility import from_wrench

STEP = 1e-4  # s
ROTATION = np.arange(N_OUTPUTS)[output_slices()["payload_rotation"]]
LOOP = loop_at(load(), np.radians([8.5, 0.0, 0.0]))


def simulate(wrench, scheme):
    """Payload rotation (steps + 1, 3) under wrenches (steps, 6), each held for a step."""
    plant, isolator = LOOP.model.step_map(STEP), LOOP.controller.step_map(STEP)
    x, c, a, f = np.zeros(LOOP.model.n_states), np.zeros(LOOP.controller.n_states), np.zeros(6), np.zeros(3)
    u, rows = np.zeros(N_INPUTS), [np.zeros(3)]
    for w in wrench:
        u[:3], u[3:9] = f, w
        found = plant @ np.concatenate([x, u])
        x = found[N_OUTPUTS:]
        seen = a if scheme == "jacobi" else found[:6]
        answer = isolator @ np.concatenate([c, seen])
        f, c, a = answer[:3], answer[3:], found[:6]
        rows.append(found[ROTATION])
    return np.array(rows)


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
def test_it_is_what_the_models_do_step_by_step(scheme):
    loop = step_loop(LOOP.model, LOOP.controller, STEP, ROTATION, scheme=scheme)
    wrench = np.random.default_rng(1).normal(size=(60, 6))
    X, rows = np.zeros(len(loop.A)), [np.zeros(3)]
    for w in wrench:
        rows.append(loop.L @ X + loop.E @ w)
        X = loop.A @ X + loop.B @ w
    expected = simulate(wrench, scheme)
    assert np.array(rows) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_without_the_isolator_it_is_continuous_time_half_a_step_late():
    loop = step_loop(LOOP.model, None, STEP, ROTATION)
    frequency = np.array([0.2, 1.0, 3.0, 10.0])
    s = 2j * np.pi * frequency
    expected = from_wrench(LOOP, s, active=False) * np.exp(-0.5 * STEP * s)[:, None, None]
    difference = np.abs(loop.response(frequency) - expected).max(axis=(1, 2))
    assert (difference / np.abs(expected).max(axis=(1, 2))).max() < 1e-4


def test_with_the_isolator_it_has_the_transmissibility_of_sampled_theory():
    """From the motion of the base to that of the payload, to second order in the step."""
    base = np.arange(N_OUTPUTS)[output_slices()["base_position"].start : output_slices()["base_rotation"].stop]
    loop = step_loop(LOOP.model, LOOP.controller, STEP, np.concatenate([ROTATION, base]))
    frequency = np.array([0.5, 1.0, 3.0, 10.0])
    found = loop.response(frequency)
    expected = from_base_sampled(LOOP, 2j * np.pi * frequency, STEP) @ found[:, 3:]
    difference = np.abs(found[:, :3] - expected).max(axis=(1, 2))
    assert (difference / np.abs(expected).max(axis=(1, 2))).max() < 1e-3


def test_an_unknown_scheme():
    with pytest.raises(ValueError, match="scheme: expected jacobi or gauss-seidel, got 'euler'"):
        step_loop(LOOP.model, LOOP.controller, STEP, ROTATION, scheme="euler")
