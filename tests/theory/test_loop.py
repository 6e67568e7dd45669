"""The internal loop with delay: Fig 10, its poles, its winding number, its longest delay."""

import numpy as np
import pytest
from support.mechanics import PAPER

from ps_fmu.mechanism.parameters import load
from ps_fmu.paper.published import published_numbers
from ps_fmu.theory.loop import delay_limit_by_bisection, loop_at
from ps_fmu.theory.margins import element_margins
from ps_fmu.theory.state_space import closed_loop

DELAY = 0.02  # s
S = 2j * np.pi * np.geomspace(0.05, 300.0, 60)  # rad/s


@pytest.fixture(scope="module")
def lighter():
    """The loop on the lighter support module, with the paper's delay."""
    return loop_at(load(bus="LSM"), delay=DELAY)


def test_fig_10_of_the_lighter_module(lighter):
    found = element_margins(lighter, (1.0, 30.0))
    assert found.gain_crossings == pytest.approx([5.157, 5.567], abs=1e-3)
    assert found.phase_crossings == pytest.approx([5.421], abs=1e-3)
    assert found.phase_margin == pytest.approx(-25.97, abs=0.01)
    for ours, key in (
        (found.gain_crossings[0], "fig10.LSM_first_crossing"),
        (found.gain_crossings[1], "fig10.LSM_second_crossing"),
        (found.phase_crossings[0], "fig10.LSM_phase_crossing"),
    ):
        assert ours == pytest.approx(published_numbers()[key].value, abs=5e-3)


def test_fig_10_of_the_original_module():
    found = element_margins(loop_at(PAPER, delay=DELAY), (1.0, 30.0))
    assert found.largest_gain_db == pytest.approx(-8.9, abs=0.05)
    assert found.gain_crossings == () and np.isnan(found.phase_margin)


def test_the_lighter_module_is_stable_with_the_papers_delay(lighter):
    """The published verdict is that of the point -1; by (48) the critical point is +1."""
    assert lighter.unstable_poles() == 0
    assert lighter.poles()[0].real < 0.0


def test_longest_delay_from_the_eigenvalues_and_by_bisection(lighter):
    assert lighter.delay_limit == pytest.approx(0.0916, abs=1e-4)
    assert delay_limit_by_bisection(lighter, 0.12, 1e-4) == pytest.approx(lighter.delay_limit, abs=1e-4)


def test_beyond_the_longest_delay_poles_and_winding_number_agree(lighter):
    for delay in (1.05 * lighter.delay_limit, 0.95 * lighter.delay_limit):
        late = lighter.with_delay(delay)
        right = late.poles()
        assert late.unstable_poles() == np.sum(right.real > 0.0)
        assert (late.unstable_poles() > 0) == (delay > lighter.delay_limit)


def test_the_original_module_is_stable_for_every_delay():
    loop = loop_at(PAPER)
    assert loop.delay_limit == np.inf
    assert delay_limit_by_bisection(loop, 1.0) == np.inf


def test_poles_without_delay_are_those_of_the_closed_state_space():
    loop = loop_at(PAPER)
    system = closed_loop(loop.model, loop.controller)
    fast = [np.sort_complex(p[np.abs(p) > 1.0]) for p in (loop.poles(), np.linalg.eigvals(system.A))]
    assert fast[0] == pytest.approx(fast[1], rel=1e-6)


def test_poles_are_zeros_of_the_characteristic_function(lighter):
    poles = lighter.poles()
    poles = poles[np.abs(poles) > 1.0]  # det(E - L) has zeros and poles side by side where the filters are
    assert len(poles) > 20
    away = np.abs(lighter.characteristic(poles * (1.0 + 1e-4)))
    assert np.all(np.abs(lighter.characteristic(poles)) < 1e-3 * away)


def test_characteristic_function_is_the_determinant(lighter):
    full = np.linalg.det(np.eye(6) - lighter.transfer(S))
    assert np.abs(lighter.characteristic(S) - full).max() < 1e-10 * np.abs(full).max()
    assert np.abs(lighter.sensitivity(S) @ (np.eye(6) - lighter.transfer(S)) - np.eye(6)).max() < 1e-9


def test_an_inverted_isolator_is_judged_against_minus_one(lighter):
    """With the sign of the force changed, the paper's reading is the right one: unstable with its delay."""
    inverted = lighter.inverted()
    assert np.abs(inverted.transfer(S) + lighter.transfer(S)).max() == 0.0
    assert inverted.unstable_poles() > 0
    assert np.sum(inverted.poles().real > 0.0) == inverted.unstable_poles()
