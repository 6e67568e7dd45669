"""The way that is expected, and what is added to the linear model along it: against the models on the way itself."""

from dataclasses import replace

import numpy as np
import pytest
from support.mechanics import rigid

from ps_fmu.mechanism.curvature import Curve, count_curve, find_curve, find_ends, places_on_path, stay
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import CoarseServo
from ps_fmu.mechanism.signals import N_INPUTS, N_OUTPUTS, RATE, TIME, servo_slices
from ps_fmu.mechanism.slews import RENEWAL, find_attitude, find_centre, find_growth, find_next_centre, look_ahead

STEP = 1e-4  # s
STILL = np.zeros(3)
SERVO = CoarseServo(frequency=5.0, damping_ratio=1.0, rate_limit=0.05)
PLANT = Plant.from_parameters(replace(rigid(), servo=SERVO))  # no modes, no rods
N = PLANT.n_coordinates
S, DS, R = servo_slices(N)
SPEED = np.array([0.05, -0.03, 0.02])  # m/s


def moving():
    """A model about a centre in a slew, on a bus that turns, its state, and input."""
    at_rest = PLANT.linearise(np.array([0.004, -0.003, 0.002]))
    x = PLANT.initial_state(at_rest, np.array([0.02, -0.01, 0.03]))
    x[:3], x[N : N + 3] = [3e-4, -2e-4, 1e-4], [0.01, 0.02, -0.01]  # m, m/s, fine legs
    x[DS], x[R] = SPEED, x[S] + 0.06 * SPEED
    u = np.zeros(N_INPUTS)
    u[0:9], u[RATE], u[-1] = [0.1, -0.2, 0.1, 1.0, 2.0, -1.0, 0.5, 0.2, -0.3], SPEED, 1.0
    return PLANT.linearise_about(find_centre(at_rest, x, np.array([1.0, 0.0, 0.0, 0.0]))), x, u


def test_without_modes_the_way_is_that_of_the_linear_model():
    model, x, u = moving()
    way = look_ahead(model, x, u, STILL, RENEWAL, STEP)
    step = model.step_map(way.half)
    for start, end in ((way.start, way.middle), (way.middle, way.end)):
        found = (step @ np.concatenate([start, u]))[N_OUTPUTS:]
        np.testing.assert_allclose(end, found, rtol=0.0, atol=1e-12)
    np.testing.assert_array_equal(way.start, x)


def test_a_reference_whose_rate_grows_goes_on_so():
    model, x, u = moving()
    growth = np.array([0.3, 0.0, -0.2])  # m/s2
    held, growing = (look_ahead(model, x, u, each, RENEWAL, STEP) for each in (STILL, growth))
    time = 2.0 * growing.half
    np.testing.assert_allclose(growing.end[R] - x[R], SPEED * time + 0.5 * growth * time**2, rtol=1e-10)
    assert np.abs(growing.end[S] - held.end[S]).max() > 3e-8  # m


def test_growth_of_a_rate_is_taken_from_references_that_moved_so():
    before, now = np.array([0.01, 0.0, 0.0]), np.array([0.03, 0.05, 0.0])
    moved = np.array([0.02 * 0.1, 0.05 * 0.01, 0.0])  # the second one started late
    np.testing.assert_allclose(find_growth(0.1, moved, before, now, RENEWAL), [0.2, 0.0, 0.0])
    assert not find_growth(0.0, moved, before, now, RENEWAL).any()


@pytest.mark.parametrize("step", [1e-5, 1e-4, 1e-3, 0.05])
def test_a_way_is_whole_steps_long_and_within_its_distances(step):
    model, x, u = moving()
    way = look_ahead(model, x, u, STILL, RENEWAL, step)
    steps = 2.0 * way.half / step
    assert steps == pytest.approx(round(steps), abs=1e-9)
    assert steps >= 1.0 - 1e-9
    if step < 0.01:
        assert np.abs(way.middle - way.start)[np.r_[0:3, S]].max() <= 10.0 * RENEWAL.relinearisation_distance
        assert way.half > 1e-3


def make_curve():
    model, x, u = moving()
    way = look_ahead(model, x, u, STILL, RENEWAL, STEP)
    about = PLANT.linearise_about(find_next_centre(model, x, 0.0, way, np.full(3, 0.01), RENEWAL))
    ends = PLANT.linearise_about_all(find_ends(model, about.centre, way))
    return about, way, find_curve(about, [end.matrices() for end in ends], way, u), u


def find_error(model, z, time, u):
    """Of rates and outputs of a model at a state, against the model about that very state; its inputs with the time."""
    there = PLANT.linearise_about(find_centre(model, z, find_attitude(model, z, time)))
    u = u.copy()
    results = []
    for each, t in ((there, 0.0), (model, time)):
        u[TIME] = t, t**2
        A, B, C, D = each.matrices()
        results.append(np.concatenate([A @ z + B @ u, C @ z + D @ u]))
    return results[1] - results[0]


def test_curved_models_are_exact_at_both_ends_and_at_the_centre():
    about, way, curve, u = make_curve()
    curved = about.curve(curve.added)
    for z, time in ((way.start, -way.half), (way.middle, 0.0), (way.end, way.half)):
        assert np.abs(find_error(curved, z, time, u)).max() < 1e-11
    assert np.abs(find_error(about, way.end, way.half, u)).max() > 1e-5


@pytest.mark.parametrize("part", [-0.5, 0.5])
def test_curved_models_are_nearly_exact_in_between(part):
    about, way, curve, u = make_curve()
    time = part * way.half
    linear, square = 0.5 * (way.end - way.start) / way.half, 0.5 * (way.end + way.start) - way.middle
    z = way.middle + linear * time + square * part**2
    left, right = (np.abs(find_error(each, z, time, u)).max() for each in (about.curve(curve.added), about))
    assert left < 0.05 * right


def test_steps_of_a_curved_model_follow_its_rates():
    """Inputs of time are means over a step: one long step, given these, is many short ones."""
    about, way, curve, u = make_curve()
    curved, n = about.curve(curve.added), 32

    def go(h, steps):
        x, t, step = way.start, -way.half, curved.step_map(h)
        for _ in range(steps):
            given = u.copy()
            given[TIME] = t + h / 2.0, t**2 + h * t + h**2 / 3.0
            result = step @ np.concatenate([x, given])
            x, t = result[N_OUTPUTS:], t + h
        return result

    h = 2.0 * way.half / n
    once, often = go(h, n), go(h / 16, 16 * n)
    np.testing.assert_allclose(once, often, rtol=0.0, atol=1e-9)
    _, _, C, D = curved.matrices()
    u[TIME] = way.half, way.half**2
    np.testing.assert_allclose(once[:N_OUTPUTS], C @ once[N_OUTPUTS:] + D @ u, rtol=0.0, atol=1e-11)


def test_path_and_numbers_of_a_curve():
    about, way, curve, _ = make_curve()
    places = places_on_path(about)
    for z, time in ((way.start, -way.half), (way.middle, 0.0), (way.end, way.half)):
        np.testing.assert_allclose(curve.path @ [1.0, time, time**2], z[places], rtol=0.0, atol=1e-14)
    numbers = np.empty(count_curve(N))
    curve.write(numbers)
    again = Curve.read(numbers, N)
    np.testing.assert_array_equal(again.added, curve.added)
    np.testing.assert_array_equal(again.path, curve.path)
    assert again.half[0] == way.half
    still = stay(about)
    assert not still.added.any()
    np.testing.assert_allclose(still.path[:, 0], way.middle[places], rtol=0.0, atol=1e-15)
