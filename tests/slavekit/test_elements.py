"""Elements of a step: what each does."""

import math

import numpy as np
import pytest
from support.bench import Bench, H, make_quiet_bench, run, use_matrix

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
    find_full_delay,
    ring_size,
)  # fmt: skip
from ps_fmu.slavekit.author.guard import ModelError


@pytest.fixture
def bench() -> Bench:
    return make_quiet_bench()


def test_sample(bench):
    bench.use([Sample(bench.u[0:2], bench.a[0:2], bench.memory[0:1], 3 * H)], [])
    found = []
    for k in range(8):
        bench.u[:] = k, -k, 0.0
        run(bench)
        found.append(bench.a[:2].tolist())
    assert found == [[k - k % 3, -(k - k % 3)] for k in range(8)]


def test_hold(bench):
    bench.use([], [Hold(bench.y[0:2], bench.memory[2:4], bench.memory[0:1], 3 * H)])
    found = []
    for k in range(8):
        bench.u[:] = k, -k, 0.0
        run(bench)
        found.append(bench.y[:2].tolist())
    assert found == [[0.0, 0.0]] * 2 + [[2.0, -2.0]] * 3 + [[5.0, -5.0]] * 3


@pytest.mark.parametrize("steps", [0, 1, 4, 7])
def test_delay(bench, steps):
    bench.use([], [Delay(bench.y[0:2], bench.memory[: ring_size(2, 7)], steps * H)])
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
    assert not bench.by_kernel("")
    assert bench.core.pending == 2
    assert bench.data.tobytes() == before.tobytes()
    bench.core.pending = bench.core.watching = 0
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


def steps_of(bench, h, n):
    """The outputs after each of n steps of h (s)."""
    bench.core.step, bench.core.count = h, 0
    found = []
    for _ in range(n):
        run(bench)
        found.append(bench.y[:2].tolist())
    return found


def test_delay_and_hold_at_another_step_size(bench):
    """A value is late by its own time, and comes out at the first end of a step from then on."""
    bench.use(
        [],
        [
            Delay(bench.y[0:1], bench.memory[: ring_size(1, 9)], 4 * H),
            Hold(bench.y[1:2], bench.memory[40:41], bench.memory[41:42], 8 * H),
        ],
    )
    for k in range(5):
        bench.u[:] = float(k + 1), 1.0, 0.0
        steps_of(bench, H, 1)
    assert steps_of(bench, H / 2, 6) == [[k, 0.0] for k in (1.0, 2.0, 2.0, 3.0, 3.0)] + [[4.0, 1.0]]
    assert [found[0] for found in steps_of(bench, 1.3 * H, 2)] == [5.0, 5.0]


def test_samples_keep_their_own_times(bench):
    """After a change of the step, and with steps that do not divide the period: at its multiples."""
    bench.use(
        [Sample(bench.u[0:1], bench.a[0:1], bench.memory[0:1], 10.0)],
        [Hold(bench.y[1:2], bench.memory[2:3], bench.memory[1:2], 10.0)],
    )
    t, taken = 0.0, [[], []]
    for h in [1.0] * 3 + [0.7] * 10 + [0.35, 7.3, 2.35] + [25.0, 1.0, 4.0] + [3.0] * 10:
        before = bench.a[0], bench.y[1]
        bench.u[:2] = t, t + h  # when the step starts, and ends
        steps_of(bench, h, 1)
        t += h
        for times, last, now in zip(taken, before, (bench.a[0], bench.y[1]), strict=True):
            if now != last:
                times.append(round(float(now), 9))
    starts, ends = taken
    assert starts == [10.0, 20.0, 50.0, 59.0, 68.0]
    assert ends == [10.0, 20.0, 45.0, 50.0, 62.0, 71.0, 80.0]


def test_samples_of_many_steps_do_not_drift(bench):
    """Thirds and sevenths of a period add up with rounding."""
    bench.use([Sample(bench.u[0:1], bench.a[0:1], bench.memory[0:1], 0.01)], [])
    for k in range(1200):
        n = (3, 7)[k % 2]
        for part in range(n):
            bench.u[0] = -1.0 if part else k
            steps_of(bench, 0.01 / n, 1)
            assert bench.a[0] == k


def test_a_delay_of_a_sample_begins_with_it(bench):
    """Not with the end of the step; without a sample in it, with its start."""
    sample = Sample(bench.u[0:1], bench.a[0:1], bench.memory[0:1], 1.0)
    bench.use([sample], [Delay(bench.y[0:1], bench.memory[1 : 1 + ring_size(1, 9)], 1.5, sample)])
    found = []
    for k, h in enumerate([0.5, 0.5, 0.5, 0.5, 0.7, 0.7, 0.7, 0.8]):  # from 0, 0.5, 1, 1.5, 2, 2.7, 3.4 and 4.1 on
        bench.u[0] = k + 1.0
        found += [row[0] for row in steps_of(bench, h, 1)]
    assert found == [0.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0]


def test_a_delay_of_held_values_begins_when_they_are_taken(bench):
    hold = Hold(bench.y[0:1], bench.memory[40:41], bench.memory[0:1], 1.0)
    bench.use([], [hold, Delay(bench.y[0:1], bench.memory[1 : 1 + ring_size(1, 9)], 1.5, hold)])
    found = []
    for k, h in enumerate([0.5, 0.5, 0.5, 0.7, 0.3, 0.2, 0.8, 0.5, 0.1]):  # to 0.5, 1, 1.5, 2.2, 2.5, 2.7, 3.5, 4, 4.1
        bench.u[0] = k + 1.0
        found += [row[0] for row in steps_of(bench, h, 1)]
    assert found == [0.0, 0.0, 0.0, 0.0, 2.0, 2.0, 4.0, 4.0, 4.0]
    assert steps_of(bench, 0.5, 1)[0][0] == 7.0  # taken at 3, in the step to 3.5


def test_a_delay_with_too_many_steps_is_refused(bench):
    delay = Delay(bench.y[0:1], bench.memory[: ring_size(1, 4)], 5 * H)
    bench.use([], [delay])
    steps_of(bench, 5 * H, 3)
    steps_of(bench, H, 2)
    assert find_full_delay(bench.core.elements, bench.data, H) == ""
    steps_of(bench, H / 2, 1)
    before = bench.data.copy()
    bench.core.step = H
    assert not bench.by_kernel("")
    assert bench.data.tobytes() == before.tobytes()
    text = "more than 4 steps lie within a delay of 0.05 s, which keeps no more"
    assert find_full_delay(bench.core.elements, bench.data, H) == text
    assert find_full_delay(bench.core.elements, bench.data, 3 * H) == ""
    steps_of(bench, 3 * H, 3)


@pytest.mark.parametrize("place", [-1.0, 0.5, 5.0, 1e300])
@pytest.mark.parametrize("kept", [0, 1])
def test_a_made_up_row_of_a_ring(bench, kept, place):
    delay = Delay(bench.y[0:1], bench.memory[: ring_size(1, 4)], 4 * H)
    bench.use([], [delay])
    bench.memory[kept] = place
    with pytest.raises(ModelError, match="delay of 1 values: it keeps the row"):
        bench.use([], [delay])
    before = bench.data.tobytes()
    if place != 0.5:  # between two rows: harmless
        assert not bench.by_kernel("")
        assert bench.data.tobytes() == before


# --- What is wrong is named, and nothing is compiled ------------------------------------


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (lambda b: Product(b.u, b.u, b.u), "Product.target: a step must not write u_0"),
        (lambda b: Product(b.u, b.u[:2], b.a), "Product.second has 2 numbers; expected 3"),
        (lambda b: Product(b.u, b.u.copy(), b.a), "Product.second does not lie in the buffer"),
        (lambda b: Product(b.u, b.u.tolist(), b.a), "Product.second: expected a view"),
        (lambda b: Product(b.u, b.u.view(np.float32)[:3], b.a), "expected numbers of the type float64"),
        (lambda b: Product(b.u, np.array([1, 2, 999]), b.a), "Product.second does not lie in the buffer"),
        (lambda b: Sample(b.u, b.a, b.memory[0:1], 0.0), "Sample.period: expected a finite time above 0 s, got 0.0"),
        (lambda b: Sample(b.u, b.a, b.a[0:1], H), "Sample.clock: expected a part of memory"),
        (lambda b: Hold(b.y[:2], b.memory[:2], b.memory[1:2], H), "Hold.clock: expected memory of its own"),
        (lambda b: Clip(b.y, 1.0, 0.0), "Clip.lower = 1.0 and upper = 0.0: expected lower <= upper"),
        (lambda b: Clip(b.y, math.nan, 0.0), "Clip.lower: expected numbers, got nan"),
        (lambda b: Clip(b.y, 0.0, 1.0, "y_0"), "Clip.flag: expected a Boolean output"),
        (lambda b: Linear(b.u, np.eye(2), b.a), r"Linear.matrix is of shape \(2, 2\); expected \(3, 3\)"),
        (lambda b: Linear(b.u, np.full((3, 3), math.inf), b.a), "Linear.matrix contains numbers that are not finite"),
        (lambda b: Ramp(b.u, b.u, b.a, -1.0), "Ramp.limit: expected 0 or greater"),
        (lambda b: Quantise(b.a, [1.0, 2.0]), "Quantise.resolution: expected a number or 3 numbers"),
        (lambda b: Quantise(b.a, -1.0), "Quantise.resolution: expected 0 or greater"),
        (lambda b: Sine(b.u, math.inf, 0.0, b.a), "Sine.factor: expected finite numbers"),
        (lambda b: Delay(b.y[:2], b.memory[:8], H), r"Delay.ring has 8 numbers; expected ring_size\(2, longest\)"),
        (lambda b: Delay(b.y[:1], b.memory[:12], -H), "Delay.delay: expected a finite time of 0 or more s"),
        (lambda b: Count(b.u, 1.0, b.memory[:6], b.y[:2]), "Count.target has 2 numbers; expected 1 or 3"),
        (lambda b: Count(b.u, 1.0, b.memory[:3], b.y[:3]), "Count.kept has 3 numbers; expected 6"),
    ],
)
def test_wrong_elements_are_named(bench, wrong, text):
    with pytest.raises(ValueError, match=f"bench.after_map: .*{text}"):
        bench.use([], [wrong(bench)])


def test_what_is_no_element(bench):
    with pytest.raises(TypeError, match="before_map contains a str"):
        bench.use(["Sample"], [])
