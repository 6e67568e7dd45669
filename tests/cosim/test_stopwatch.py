"""The stopwatch of the steps: it changes no result, counts each step, and knows every part."""

import gc
import math

import pytest
from support.cosim import Collect

from ps_fmu.cosim import Master
from ps_fmu.cosim.plan import Plan
from ps_fmu.cosim.stopwatch import EXCHANGE, Laps, Stopwatch

H = 0.01
STEPS = 40


@pytest.fixture
def system(make_system):
    """Two that are wired in a loop and one that has no input connected."""
    return make_system(
        {"mass": "ToyMass", "spring": "ToySpring", "counter": "ToyCounter"},
        ["mass.position -> spring.position", "mass.velocity -> spring.velocity", "spring.force -> mass.force"],
    )


def run(system, stopwatch=None, **options):
    collect = Collect()
    with Master(system, H, stopwatch=stopwatch, **options) as master:
        master.initialise()
        master.run(STEPS // 2 * H, [collect])
        master.set("mass.force", 0.5)  # makes a new plan
        master.run(STEPS // 2 * H, [collect])
    return collect.values


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
def test_rows_are_the_same_bit_for_bit(system, scheme):
    plain = run(system, scheme=scheme)
    assert run(system, Stopwatch(), scheme=scheme).tobytes() == plain.tobytes()


def test_all_parts_of_all_plans_are_in_it(system):
    stopwatch = Stopwatch()
    run(system, stopwatch)
    costs = stopwatch.read()
    assert costs.steps == STEPS
    assert set(costs.parts) == {"mass", "spring", "counter", EXCHANGE}
    assert all(part.total_s > 0.0 for part in costs.parts.values())
    assert sum(part.total_s for part in costs.parts.values()) <= costs.total_s * (1.0 + 1e-12)
    assert costs.parts["counter"].set_s == 0.0, "nothing is connected to it"
    assert costs.parts[EXCHANGE].step_s == costs.parts[EXCHANGE].get_s == 0.0
    assert max(part.longest_s for part in costs.parts.values()) <= costs.longest_s <= costs.total_s
    assert 0.0 <= costs.longest_at < STEPS * H


def test_what_has_not_begun_has_cost_nothing():
    costs = Stopwatch().read()
    assert (costs.steps, costs.parts, costs.total_s, costs.longest_s) == (0, {}, 0.0, 0.0)
    assert math.isnan(costs.longest_at)


def test_a_warning_is_counted_and_costs_no_step(system, answer):
    answer("spring", "fmi2DoStep", 1, n=0, really=True)
    stopwatch = Stopwatch()
    with Master(system, H, stopwatch=stopwatch) as master:
        master.initialise()
        master.run(STEPS * H)
        assert master.warnings["spring"] == STEPS
    costs = stopwatch.read()
    assert costs.steps == STEPS
    assert sum(part.total_s for part in costs.parts.values()) <= costs.total_s * (1.0 + 1e-12)
    assert max(part.longest_s for part in costs.parts.values()) <= costs.longest_s


def test_it_does_not_grow_with_the_resets_of_a_master(system):
    stopwatch = Stopwatch()
    held = []
    with Master(system, H, stopwatch=stopwatch) as master:
        for number in range(5):
            master.reset({"mass.mass": 1.0 + number})
            master.initialise()
            master.run(STEPS * H)
            gc.collect()
            held.append(sum(isinstance(one, Plan | Laps) for one in gc.get_objects()))
    assert held[1:] == held[:-1]
    assert stopwatch.read().steps == 5 * STEPS
