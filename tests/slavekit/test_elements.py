"""Elements of a step: what each does, and the same bits in Python and by the launcher's kernels."""

import ctypes
import math

import numpy as np
import pytest

from ps_fmu.slavekit.author.core import MAP, Core, Elements, OutputLimits, make_core, store_by_columns
from ps_fmu.slavekit.author.elements import (
    Clip,
    Count,
    Delay,
    Element,
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
from ps_fmu.slavekit.author.layout import BufferLayout
from ps_fmu.slavekit.author.plain import make_plain_step
from ps_fmu.slavekit.author.program import change_step, compile_elements
from ps_fmu.slavekit.author.slave import Port
from ps_fmu.slavekit.launcher.compile import LAUNCHER

H = 0.01  # s
N_OUTPUTS, N_STATES, N_INPUTS, N_AUXILIARY, N_ROW, N_MEMORY = 5, 4, 3, 3, 2, 60


class Bench:
    """A core with room for all kinds of elements, and what takes part of its buffer."""

    def __init__(self, seed: int = 0) -> None:
        ports = [Port(f"y_{i}", "output") for i in range(N_OUTPUTS)]
        ports += [Port("flag", "output", type="Boolean")]
        ports += [Port(f"u_{i}", "input") for i in range(N_INPUTS)] + [Port("p", "parameter")]
        self.layout = BufferLayout("bench", "1", ports, N_STATES, N_AUXILIARY, N_MEMORY, N_ROW)
        self.data = np.zeros(self.layout.size)
        self.core: Core = make_core(self.layout, self.data)
        self.core.step = H
        parts = ("y", "x", "u", "a", "r", "memory")
        self.y, self.x, self.u, self.a, self.r, self.memory = (self.data[getattr(self.layout, p)] for p in parts)
        self.random = np.random.default_rng(seed)
        self.taken = 0
        self.rows = 100
        self.core.use_rows(self.random.standard_normal((self.rows, N_ROW)))
        shape = self.layout.target.stop, self.layout.source.stop - self.layout.source.start
        matrix = self.random.standard_normal(shape) * self.random.choice([0.0, 0.3], shape)
        self.core.use_map(store_by_columns(matrix))
        self.core.watching = 0

    def keep(self, n: int) -> np.ndarray:
        """Memory that nothing else uses."""
        self.taken += n
        assert self.taken <= N_MEMORY
        return self.memory[self.taken - n : self.taken]

    def use(self, before: list[Element], after: list[Element]) -> None:
        self.core.use_elements(compile_elements(self.layout, self.data, before, after))

    def by_kernel(self, instructions: str) -> bool:
        library = ctypes.CDLL(str(LAUNCHER.path("linux64")))
        answer = library.ps_fmu_step_by(instructions.encode(), ctypes.byref(self.core))
        if answer < 0:
            pytest.skip(f"this processor lacks {instructions}")
        return bool(answer)

    def random_operand(self, n: int, *, written: bool) -> np.ndarray:
        """A view, or places in any order."""
        views = [self.y, self.x, self.a, self.memory[-6:], *(() if written else (self.u, self.r, self.memory))]
        view = views[self.random.integers(len(views))]
        if view.size >= n and self.random.random() < 0.5:
            first = self.random.integers(view.size - n + 1)
            return view[first : first + n]
        starts = [(other.ctypes.data - self.data.ctypes.data) // 8 for other in views]
        every = np.concatenate([start + np.arange(v.size) for start, v in zip(starts, views, strict=True)])
        return self.random.choice(every, n).astype(np.int64)

    def random_element(self) -> Element:
        random, n = self.random, int(self.random.integers(1, 4))
        value, target = self.random_operand(n, written=False), self.random_operand(n, written=True)
        other, every = self.random_operand(n, written=False), int(random.integers(1, 5))
        some = np.sort(random.standard_normal((2, n)), axis=0)
        choice = random.integers(12)
        if choice in (0, 8, 9) and self.taken + 1 + 6 * n > N_MEMORY - 6:
            choice = 7
        match choice:
            case 0:
                return Sample(value, target, self.keep(1), every)
            case 1:
                return Ramp(value, other, target, np.abs(some[0]) * random.choice([1.0, math.inf]))
            case 2:
                return Product(value, other, target)
            case 3:
                return Linear(value, random.standard_normal((n, n)) * random.choice([0.0, 1.0], (n, n)), target)
            case 4:
                return Clip(target, some[0], some[1], random.choice([None, "flag"]))
            case 5:
                return Excess(value, some[0], some[1], target)
            case 6:
                return Sine(value, some[0], some[1], target)
            case 7:
                return Quantise(target, random.choice([0.0, 0.1, 1e-3], n))
            case 8:
                return Hold(target, self.keep(n), self.keep(1), every)
            case 9:
                return Delay(target, self.keep(ring_size(n, 5)), int(random.integers(0, 6)))
            case 10:
                return Watch(value, other, np.abs(some[0]))
            case _:
                return (
                    Count(value, np.abs(some[0]), self.keep(2 * n), target[: random.choice([1, n])])
                    if (self.taken + 2 * n <= N_MEMORY - 6)
                    else Product(value, other, target)
                )


@pytest.fixture(params=["sse2", "avx2", "avx512"])
def instructions(request) -> str:
    return request.param


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("seed", range(25))
def test_random_programs_have_the_same_bits(instructions, seed):
    """All or nothing as well: some steps are refused for an input that is too large, or for a number that overflows."""
    kernel, plain = Bench(seed), Bench(seed)
    for bench in (kernel, plain):
        before, after = ([bench.random_element() for _ in range(bench.random.integers(6))] for _ in range(2))
        bench.use(before, after)
        bench.core.use_limits(OutputLimits(np.full(6, -1e3), np.full(6, 1e3), 5) if seed % 2 else None)
    step = make_plain_step(plain.core)
    inputs = np.random.default_rng(seed)
    outcomes = set()
    for k in range(60):
        u = inputs.choice([0.0, -0.0, 1e-3, 5e-324, -0.5, 1.0, 2.5, 1e308 if k % 20 == 19 else 3.0], N_INPUTS)
        before = plain.data.copy()
        for bench in (kernel, plain):
            bench.u[:] = u
        before[plain.layout.u] = u
        kernel.core.pending = plain.core.pending = 0
        done = kernel.by_kernel(instructions)
        assert step() == done
        assert plain.data.tobytes() == kernel.data.tobytes()
        assert plain.core.pending == kernel.core.pending
        if not done:
            assert plain.data.tobytes() == before.tobytes()
            for bench in (kernel, plain):
                bench.x[:] = bench.a[:] = 0.1  # or it would never be finite again
        for bench in (kernel, plain):
            bench.core.count += 1
        outcomes.add(done)
    assert True in outcomes


def run(bench: Bench, n: int = 1) -> None:
    """Steps by the kernel, which has to make them; Python's is made beside it and compared."""
    twin = make_plain_step(bench.core)
    for _ in range(n):
        before, pending = bench.data.copy(), bench.core.pending
        assert twin()
        found, due = bench.data.tobytes(), bench.core.pending
        bench.data[:], bench.core.pending = before, pending
        assert bench.by_kernel("sse2")
        assert (bench.data.tobytes(), bench.core.pending) == (found, due)
        bench.core.count += 1


@pytest.fixture
def bench() -> Bench:
    """A bench whose map copies the inputs to the first outputs, and does nothing else."""
    found = Bench()
    matrix = np.zeros((found.layout.target.stop, 7))
    matrix[:3, 4:7] = np.eye(3)  # u after the four states; the columns of a and r are left out
    found.core.use_map(store_by_columns(matrix))
    return found


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
    bench.core.use_map(store_by_columns(matrix))
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


# --- What is wrong ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        (lambda b: Product(b.u, b.u, b.u), "Product.target: a step must not write u_0"),
        (lambda b: Product(b.u, b.u[:2], b.a), "Product.second has 2 numbers; expected 3"),
        (lambda b: Product(b.u, b.u.copy(), b.a), "Product.second does not lie in the buffer"),
        (lambda b: Product(b.u, b.u.tolist(), b.a), "Product.second: expected a view"),
        (lambda b: Product(b.u, b.u.view(np.float32)[:3], b.a), "expected numbers of the type float64"),
        (lambda b: Product(b.u, np.array([1, 2, 999]), b.a), "Product.second does not lie in the buffer"),
        (lambda b: Sample(b.u, b.a, b.memory[0:1], 0), "Sample.every: expected a whole number from 1 on, got 0"),
        (lambda b: Sample(b.u, b.a, b.a[0:1], 1), "Sample.clock: expected a part of memory"),
        (lambda b: Hold(b.y[:2], b.memory[:2], b.memory[1:2], 1), "Hold.clock: expected memory of its own"),
        (lambda b: Clip(b.y, 1.0, 0.0), "Clip.lower = 1.0 and upper = 0.0: expected lower <= upper"),
        (lambda b: Clip(b.y, math.nan, 0.0), "Clip.lower: expected numbers, got nan"),
        (lambda b: Clip(b.y, 0.0, 1.0, "y_0"), "Clip.flag: expected a Boolean output"),
        (lambda b: Linear(b.u, np.eye(2), b.a), r"Linear.matrix has shape \(2, 2\); expected \(3, 3\)"),
        (lambda b: Linear(b.u, np.full((3, 3), math.inf), b.a), "Linear.matrix has elements that are not finite"),
        (lambda b: Ramp(b.u, b.u, b.a, -1.0), "Ramp.limit: expected 0 or greater"),
        (lambda b: Quantise(b.a, [1.0, 2.0]), "Quantise.resolution: expected a number or 3 numbers"),
        (lambda b: Quantise(b.a, -1.0), "Quantise.resolution: expected 0 or greater"),
        (lambda b: Sine(b.u, math.inf, 0.0, b.a), "Sine.factor: expected finite numbers"),
        (lambda b: Delay(b.y[:2], b.memory[:8], 1), r"Delay.ring has 8 numbers; expected ring_size\(2, longest\)"),
        (lambda b: Delay(b.y[:1], b.memory[:4], 4), "Delay.steps = 4; the ring holds 3"),
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


def test_times_in_steps():
    assert [count_steps("delay", t, H) for t in (0.0, 0.01, 0.3)] == [0, 1, 30]
    with pytest.raises(ModelError, match=r"delay: 0.015 s is not a multiple of the communication step 0.01 s"):
        count_steps("delay", 0.015, H)
    with pytest.raises(ModelError, match=r"delay: 0.05 s is 5 steps of 0.01 s; at most 4 are kept"):
        count_steps("delay", 0.05, H, 4)
    assert isinstance(Elements().before, tuple)
    assert MAP == 1
