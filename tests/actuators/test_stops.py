"""The stops: restitution, and which steps an explicit exchange allows."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from support.mechanics import restitution

from ps_fmu.actuators.stops import STEPS_AHEAD
from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load

STOPS = Coils.from_parameters(load()).stop


@pytest.mark.parametrize("damping", [0.0, 10.0, 100.0])
def test_restitution_is_that_of_the_motion(damping):
    """A free body, integrated until it leaves the stop."""
    stop, speed, mass = replace(STOPS, damping=damping), 0.05, 6.0

    def motion(t, state):
        compression = state[0] - stop.distance
        return [state[1], -stop.stiffness * compression * max(1.0 + stop.damping * state[1], 0.0) / mass]

    def leaves(t, state):
        return state[0] - stop.distance

    leaves.terminal, leaves.direction = True, -1.0
    found = solve_ivp(motion, (0.0, 0.1), [stop.distance, speed], events=leaves, rtol=1e-10, atol=1e-14)
    assert -found.y_events[0][0][1] / speed == pytest.approx(restitution(damping, speed), abs=1e-6)


def test_restitution_of_small_damping():
    assert restitution(0.0, 0.1) == 1.0
    assert restitution(1e-2, 0.1) == pytest.approx(1.0 - 2.0 / 3.0 * 1e-3, rel=1e-6)


def find_growth(stiffness, damping, mass, h):
    """Spectral radius of a free body against a spring and damper whose force comes one step late."""
    ahead = np.array([[1.0, h, 0.5 * h**2 / mass], [0.0, 1.0, h / mass], [0.0, 0.0, 0.0]])
    ahead[2] = [-stiffness, -stiffness * STEPS_AHEAD * h - damping, 0.0]
    return np.abs(np.linalg.eigvals(ahead)).max()


@pytest.mark.parametrize("damping", [60.0, 200.0])  # s/m: strong enough for the damping to set the limit
def test_largest_step_is_where_contacts_become_unstable(damping):
    stop = replace(STOPS, damping=damping)
    full = stop.stiffness * damping * stop.distance  # N.s/m, at a compression of the whole stroke
    largest = stop.find_largest_step()
    assert find_growth(stop.stiffness, full, stop.effective_mass, 0.999 * largest) < 1.0
    assert find_growth(stop.stiffness, full, stop.effective_mass, 1.001 * largest) > 1.0


def test_largest_step_without_damping_is_that_of_the_stiffness():
    """a = 1/4: the limit of b = 1/4 alone is stable up to there."""
    stop = replace(STOPS, damping=0.0)
    largest = stop.find_largest_step()
    assert largest == pytest.approx(0.5 * np.sqrt(stop.effective_mass / stop.stiffness))
    for factor, stable in ((0.99, True), (1.01, False)):
        h = factor * largest
        damping = 0.25 * stop.effective_mass / h
        assert (find_growth(stop.stiffness, damping, stop.effective_mass, h) < 1.0) == stable
    assert replace(stop, distance=0.0).find_largest_step() == np.inf


@pytest.mark.parametrize("h", [1e-4, 1e-3])
def test_damping_that_the_leg_needs(h):
    """What the FMU warns of."""
    needed = STOPS.stiffness**2 * h**3 / STOPS.effective_mass
    growth = [find_growth(STOPS.stiffness, factor * needed, STOPS.effective_mass, h) for factor in (0.5, 1.5)]
    assert growth[0] > 1.0 > growth[1]


def test_effective_mass_is_not_above_that_of_the_paper_s_mechanism():
    """Largest acceleration of the legs for a unit force along them, all three at once, over the workspace."""
    plant, masses = Plant.from_parameters(load()), []
    for coarse in ((0.0, 0.0, 0.0), (0.02, -0.02, 0.02), (-0.02, -0.02, -0.02), (0.02, 0.02, -0.02)):
        dynamics = plant.linearise(np.array(coarse)).dynamics
        mobility = np.linalg.inv(dynamics.M[np.ix_(dynamics.active, dynamics.active)])[:3, :3]
        masses.append(1.0 / np.linalg.eigvalsh(mobility).max())
    assert STOPS.effective_mass <= min(masses) < 1.1 * STOPS.effective_mass


def test_contact_steps():
    assert STOPS.count_contact_steps(1e-4) == pytest.approx(169.2, rel=1e-3)
    assert replace(STOPS, stiffness=0.0).count_contact_steps(1e-4) == np.inf
