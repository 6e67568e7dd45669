"""Elements of a step: what each does, by the kernel and in Python."""

import math

import numpy as np
import pytest
from support.bench import Bench, H, make_quiet_bench, run, use_matrix

from ps_fmu.slavekit.author.core import MAP, Elements
from ps_fmu.slavekit.author.elements import (
    Clip,
    Count,
    Delay,
    Excess,
    Hold,
    Linear,
    Product,
    Quantise,
    Ramp,
    Sample,
    Sine,
    Watch,
    count_steps,
    ring_size,
)
from ps_fmu.slavekit.author.guard import ModelError
from ps_fmu.slavekit.author.plain import make_plain_step
from ps_fmu.slavekit.author.program import change_step


@pytest.fixture
def bench() -> Bench:
    return make_quiet_bench()


def test_sample(bench):
    bench.use([Sample(bench.u[0:2], bench.a[0:2], bench.memory[0:1], 3)], [])
    found = []
    for k in range(8):
        bench.u[:] = k, -k, 0.0
        run(bench)
        found.append(bench.a[:2].tolist())
    assert found == [[k - k % 3, -(k - k % 3)] for k in range(8)]


def test_hold(bench):
    bench.use([], [Hold(bench.y[0:2], bench.memory[2:4], bench.memory[0:1], 3)])
    found = []
    for k in range(8):
        bench.u[:] = k, -k, 0.0
        run(bench)
        found.append(bench.y[:2].tolist())
    assert found == [[0.0, 0.0]] * 2 + [[2.0, -2.0]] * 3 + [[5.0, -5.0]] * 3


@pytest.mark.parametrize("steps", [0, 1, 4, 7])
def test_delay(bench, steps):
    bench.use([], [Delay(bench.y[0:2], bench.memory[: ring_size(2, 7)], steps)])
    found = []
    for k in range(20):
        bench.u[:] = k + 1.0, -k, 0.0
        run(bench)
        found.append(bench.y[:2].tolist())
    assert found == [[0.0, 0.0]] * steps + [[k + 1.0, -k] for k in range(20 - steps)]


def test_ramp(bench):
    """With the map that integrates the rate, a reference follows a command in time."""
    bench.use([Ramp(bench.u[0:2], bench.x[0:2], bench.a[0:2], [2.0, math.inf])], [])
    matrix = np.zeros((bench.layout.target.stop, 10))
    matrix[6, [0, 7]] = matrix[7, [1, 8]] = 1.0, H
    use_matrix(bench.core, matrix)
    bench.u[:] = 0.05, -3.0, 0.0
    found = []
    for _ in range(4):
        run(bench)
        found.append(bench.x[:2].tolist())
    np.testing.assert_allclose(found, [[0.02, -3.0], [0.04, -3.0], [0.05, -3.0], [0.05, -3.0]], atol=1e-15)
    assert bench.a[:2].tolist() == [0.0, 0.0]


def test_product_linear_excess_and_sine(bench):
    places = (bench.u.ctypes.data - bench.data.ctypes.data) // 8 + np.arange(3)
    bench.use(
        [
            Product(places[[0, 0, 1]], places[[0, 1, 1]], bench.memory[0:3]),
            Linear(bench.memory[0:3], [[1.0, 2.0, 1.0]], bench.memory[3:4]),
            Excess(bench.u, [-1.0, -1.0, -math.inf], 2.0, bench.memory[4:7]),
            Sine(bench.u[0:2], 0.5, [0.0, 1.0], bench.memory[7:9]),
        ],
        [Linear(bench.y[0:3], np.diag([1.0, 2.0, 3.0]), bench.y[0:3])],
    )
    bench.u[:] = 3.0, -4.0, -5.0
    run(bench)
    assert bench.memory[:4].tolist() == [9.0, -12.0, 16.0, 1.0]  # the last is the square of the sum
    assert bench.memory[4:7].tolist() == [1.0, -3.0, 0.0]
    assert bench.memory[7:9].tolist() == [math.sin(1.5), math.sin(-1.0)]
    assert bench.y[:3].tolist() == [3.0, -8.0, -15.0]


def test_clip_and_quantise(bench):
    bench.use([], [Quantise(bench.y[0:3], [0.5, 0.0, 2.0]), Clip(bench.y[0:3], -1.0, [1.0, 1.0, math.inf], "flag")])
    for u, expected in (
        ([0.74, 0.74, 1.0], [0.5, 0.74, 0.0, 0.0]),  # halfway: to the even multiple
        ([-0.2, 7.0, 3.0], [-0.0, 1.0, 4.0, 1.0]),
        ([-9.0, 0.0, 9e9], [-1.0, 0.0, 9e9, 1.0]),
    ):
        bench.u[:] = u
        run(bench)
        assert [*bench.y[:3], bench.y[5]] == expected
        assert math.copysign(1.0, bench.y[0]) == math.copysign(1.0, expected[0])


def test_watch_after_the_map(bench):
    bench.memory[:2] = 1.0, -1.0
    bench.use([], [Watch(bench.y[0:2], bench.memory[0:2], 0.5)])
    for u, due in (([1.5, -1.5], 0), ([1.51, -1.0], 1), ([1.0, -0.4], 1)):
        bench.u[:2], bench.core.pending = u, 0
        run(bench)
        assert bench.core.pending == due


def test_watch_before_the_map_keeps_the_step_for_an_event(bench):
    bench.use([Product(bench.u, bench.u, bench.a), Watch(bench.u[0:1], bench.memory[0:1], 0.5)], [])
    bench.core.watching = 1
    run(bench)
    bench.u[0] = 0.6
    before = bench.data.copy()
    for step in (make_plain_step(bench.core), lambda: bench.by_kernel("sse2")):
        assert not step()
        assert bench.core.pending == 2
        assert bench.data.tobytes() == before.tobytes()
        bench.core.pending = 0
    bench.core.watching = 0
    run(bench)


def test_watch_for_what_comes_to_rest(bench):
    bench.use([Watch(bench.u[0:1], bench.memory[0:1], 1.0, bench.memory[1:2], 0.01)], [])
    found = []
    for value in (0.0, 0.2, 0.4, 0.4, 0.005, 0.005, 1.5):
        bench.u[0], bench.core.watching = value, 1
        found.append(bench.by_kernel("sse2"))
        bench.core.watching = 0
        if not found[-1]:
            run(bench)  # as after an event that has not moved the centre
    assert found == [True, True, True, False, True, True, False]


def test_watch_for_several_that_come_to_rest(bench):
    bench.use([Watch(bench.u[0:2], bench.memory[0:2], 1.0, bench.memory[2:4], 0.01)], [])
    found = []
    for values in ([0.0, 0.2], [0.1, 0.2], [0.1, 0.3], [0.1, 0.3], [0.0, 0.3], [0.0, 0.0], [0.0, 0.0], [0.0, -1.5]):
        bench.u[:2], bench.core.watching = values, 1
        found.append(bench.by_kernel("sse2"))
        bench.core.watching = 0
        if not found[-1]:
            run(bench)
    assert found == [True, True, True, False, True, True, True, False]


@pytest.mark.parametrize("together", [False, True])
def test_count(bench, together):
    target = bench.y[3:4] if together else bench.y[3:5]
    bench.use([], [Count(bench.y[0:2], [1.0, 0.0], bench.memory[0:4], target)])
    found = []
    for u in ([1.0, 0.0], [-1.1, 0.0], [1.2, 3.0], [0.0, -3.0], [2.0, 0.0], [2.0, 1.0]):
        bench.u[:2] = u
        run(bench)
        found.append(bench.y[3:5].tolist())
    each = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [1.0, 1.0], [2.0, 1.0], [2.0, 2.0]]
    assert found == ([[sum(counts), 0.0] for counts in each] if together else each)


# --- Another step size ------------------------------------------------------------------


def test_rings_and_clocks_at_another_step_size(bench):
    bench.use(
        [], [Delay(bench.y[0:1], bench.memory[:9], 4), Hold(bench.y[1:2], bench.memory[9:10], bench.memory[10:11], 8)]
    )
    for k in range(5):
        bench.u[:] = float(k + 1), 1.0, 0.0
        run(bench)
    assert bench.memory[10] == 5.0
    change_step(bench.core.elements, bench.data, H, H / 2)
    assert bench.memory[10] == 10.0
    bench.use(
        [], [Delay(bench.y[0:1], bench.memory[:9], 8), Hold(bench.y[1:2], bench.memory[9:10], bench.memory[10:11], 16)]
    )
    found = []
    for _ in range(6):
        run(bench)
        found.append(bench.y[:2].tolist())
    assert found == [[k, 0.0] for k in (1.5, 2.0, 2.5, 3.0, 3.5)] + [[4.0, 1.0]]


def test_a_step_size_that_leads_nowhere_is_refused(bench):
    bench.use([Sample(bench.u[0:1], bench.a[0:1], bench.memory[0:1], 2)], [])
    bench.memory[0] = 1.0
    with pytest.raises(ModelError, match="cannot change from 1e\\+300 s to 1e-300 s"):
        change_step(bench.core.elements, bench.data, 1e300, 1e-300)


@pytest.mark.parametrize("place", [-1.0, 0.5, 5.0, 1e300])
def test_a_made_up_place_in_a_ring(bench, place):
    delay = Delay(bench.y[0:1], bench.memory[:6], 4)
    bench.use([], [delay])
    step = make_plain_step(bench.core)
    bench.memory[0] = place
    with pytest.raises(ModelError, match="delay of 1 values: its memory begins with"):
        bench.use([], [delay])
    before = bench.data.tobytes()
    if place != 0.5:  # between two rows: harmless
        assert not step()
        assert not bench.by_kernel("sse2")
        assert bench.data.tobytes() == before


def test_times_in_steps():
    assert [count_steps("delay", t, H) for t in (0.0, 0.01, 0.3)] == [0, 1, 30]
    with pytest.raises(ModelError, match=r"delay: 0.015 s is not a multiple of the communication step 0.01 s"):
        count_steps("delay", 0.015, H)
    with pytest.raises(ModelError, match=r"delay: 0.05 s is 5 steps of 0.01 s; at most 4 are kept"):
        count_steps("delay", 0.05, H, 4)
    assert isinstance(Elements().before, tuple)
    assert MAP == 1
