"""Plain steps, elements and limits: the bits of their definitions, whatever the processor."""

import ctypes
import math
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from support.bench import N_INPUTS, Bench, H, core_of, step_by_kernel, use_matrix
from support.defined_step import DefinedStep
from support.states import start_stepping

from ps_fmu.numerics.library import find_library
from ps_fmu.slavekit.author.core import OutputLimits
from ps_fmu.slavekit.author.elements import Delay, Linear, Product, ring_size
from ps_fmu.slavekit.author.slave import Port, Slave

# --- Plain steps: the same bits, whatever the processor -----------------------------------------------------------

@pytest.fixture(params=["", "sse2", "avx2", "avx512"])
def instructions(request) -> str:
    return request.param


@pytest.fixture(params=[True, False], ids=["dense", "blocks"])
def dense(request) -> bool:
    return request.param


def test_products_have_the_same_bits(instructions, dense):
    for sizes in product([1, 2, 7, 38], [0, 1, 6, 49, 100], [1, 2, 19]):
        n_outputs, n_states, n_inputs = sizes
        core, data = core_of(n_outputs, n_states, n_inputs)
        random = np.random.default_rng(n_outputs + 100 * n_states + 10_000 * n_inputs)
        m, n = n_outputs + n_states, n_states + n_inputs
        matrix = random.standard_normal((m, n)) * 10.0 ** random.integers(-12, 12, (m, n))
        use_matrix(core, matrix, dense=dense)
        data[:] = random.standard_normal(data.size)
        data[::5] = -0.0
        operand = data[n_outputs : n_outputs + n].copy()
        assert step_by_kernel(instructions, core)
        sums = np.zeros(m)
        for j, value in enumerate(operand):  # in this order, each operation rounded
            sums += matrix[:, j] * value
        assert data[:m].tobytes() == sums.tobytes(), sizes
        exact = [math.fsum(matrix[i] * operand) for i in range(m)]
        assert (np.abs(data[:m] - exact) <= 1e-14 * np.abs(matrix * operand).sum(axis=1)).all(), sizes


def test_limits(instructions):
    core, data = core_of(3, 0, 3)
    use_matrix(core, np.eye(3))
    core.use_limits(OutputLimits(np.array([0.0, -1.0, -np.inf]), np.array([1.0, 1.0, np.inf]), 2))
    for inputs, expected in (([0.5, 2.0, 0.0], [0.5, 1.0, 1.0]), ([-0.5, -2.0, 0.0], [0.0, -1.0, 1.0]),
                             ([-0.0, 1.0, 0.0], [0.0, 1.0, 0.0])):  # fmt: skip
        data[3:] = inputs
        assert step_by_kernel(instructions, core)
        assert data[:3].tolist() == expected


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("matrix", [[[1e200], [1.0]], [[1.0], [1e200]]])
def test_a_result_that_is_not_finite_changes_nothing(instructions, dense, matrix):
    core, data = core_of(1, 1, 0)
    use_matrix(core, np.array(matrix), dense=dense)
    core.use_limits(OutputLimits(np.array([-1.0]), np.array([1.0]), -1))
    data[:] = 5.0, 1e200
    assert not step_by_kernel(instructions, core)
    assert data.tolist() == [5.0, 1e200]
    data[:] = 5.0, 1e100
    assert step_by_kernel(instructions, core)
    assert data[0] == 1.0


def test_nothing_to_be_done(instructions):
    core, _ = core_of(1, 1, 0)
    core.use_nothing()
    assert not step_by_kernel(instructions, core)


def test_operands_that_are_zero_change_no_bit(instructions, dense):
    """Whatever is multiplied by 0 or -0, all partial sums among them: negative, below the smallest normal number."""
    core, data = core_of(3, 4, 4)
    tiny = 5e-324
    columns = np.array([[-tiny, tiny, 1.0, -1.0, 1e307, -tiny, -1e307]] * 8).T
    use_matrix(core, columns, dense=dense)
    random = np.random.default_rng(5)
    for _ in range(50):
        data[:] = random.choice([0.0, -0.0, tiny, -tiny, 0.25, -0.25, 1.0, -1.0], data.size)
        before = data.copy()
        sums = [0.0] * 7
        for j, operand in enumerate(before[3:11].tolist()):
            sums = [value + entry * operand for value, entry in zip(sums, columns[:, j].tolist(), strict=True)]
        assert step_by_kernel(instructions, core)
        assert data[:7].tobytes() == np.array(sums).tobytes()


def test_unknown_instructions():
    core, _ = core_of(1, 1, 0)
    assert find_library().ps_fmu_step_by(b"mmx", ctypes.byref(core)) == -1


# --- Limits of a model ------------------------------------------------------------------


class Held(Slave):
    ports = (
        Port("sum", "output"),
        Port("last", "output"),
        Port("held", "output", type="Boolean"),
        Port("signal", "input"),
        Port("limit", "parameter", start=1.0),
    )
    n_states = 1  # last signal
    limit_flag = "held"

    def step_map(self, h):
        return np.array([[1.0, 1.0], [0.0, 1.0], [0.0, 0.0], [0.0, 1.0]])

    def limits(self):
        bound = np.array([self.value("limit"), np.inf, np.inf])
        return (-bound, bound) if self.value("limit") else None


@pytest.fixture
def held(put) -> Callable[..., Held]:
    """``held(limit=2.0)``: an instance in its stepping phase."""

    def make(**values: float) -> Held:
        slave = Held(instance_name="h")
        put(slave, **values)
        start_stepping(slave)
        return slave

    return make


def outputs(slave: Held, signal: list[float]) -> list[list[float]]:
    rows = []
    for k, value in enumerate(signal):
        slave.set_real([slave.layout.find("signal")], [value])
        assert slave.do_step(k * H, H)
        rows.append(slave.y.tolist())
    return rows


def test_outputs_are_held_within_limits_and_states_are_not(held):
    signal = [0.4, 0.5, 0.6, -3.0, 3.0]
    expected = [[0.4, 0.4, 0.0], [0.9, 0.5, 0.0], [1.0, 0.6, 1.0], [-1.0, -3.0, 1.0], [0.0, 3.0, 0.0]]
    assert outputs(held(), signal) == expected
    assert outputs(held(limit=0.0), signal)[3] == [-2.4, -3.0, 0.0]


@pytest.mark.parametrize("limits", [(np.zeros(2), np.ones(2)), (np.ones(3), np.zeros(3)), (np.full(3, np.nan),) * 2])
def test_wrong_limits_are_faults(held, limits):
    slave = held()
    slave.limits = lambda: limits
    with pytest.raises(ValueError, match=r"Held\.limits: expected two arrays \(3,\), lower <= upper"):
        slave.do_step(0.0, H)


def test_the_flag_is_a_boolean_output():
    with pytest.raises(TypeError, match="limit_flag: expected a Boolean output, got 'sum'"):
        type("Wrong", (Held,), {"limit_flag": "sum"})


# --- Random programs of elements: the bits of their definitions, whatever the processor ---------------------------

def test_random_programs_do_what_their_elements_say(instructions):
    """All or nothing as well: some steps are refused for an input that is too large, or for a number that overflows."""
    for seed in range(25):
        bench = Bench(seed)
        before, after = ([bench.random_element() for _ in range(bench.random.integers(6))] for _ in range(2))
        bench.use(before, after)
        limit = 1e3 if seed % 2 else np.inf
        bench.core.use_limits(OutputLimits(np.full(6, -limit), np.full(6, limit), 5) if seed % 2 else None)
        definition = DefinedStep(bench, before, after, limit)
        inputs = np.random.default_rng(seed)
        outcomes = {step_as_defined(bench, definition, inputs, k, instructions) for k in range(60)}
        assert True in outcomes, seed


def step_as_defined(bench, definition, inputs, k, instructions) -> bool:
    """Whether the step is done; its bits are those of the definition."""
    bench.u[:] = inputs.choice([0.0, -0.0, 1e-3, 5e-324, -0.5, 1.0, 2.5, 1e308 if k % 20 == 19 else 3.0], N_INPUTS)
    start, bench.core.pending = bench.data.copy(), 0
    expected = definition.step(start)
    done = bench.by_kernel(instructions)
    assert done == (expected is not None)
    if expected is None:
        assert bench.data.tobytes() == start.tobytes()
        bench.x[:] = bench.a[:] = 0.1  # or it would never be finite again
    else:
        data, due = expected
        data[definition.kept] = bench.data[definition.kept]
        assert bench.data.tobytes() == data.tobytes()
        assert bench.core.pending == due
    bench.core.count += 1
    return done


@pytest.mark.parametrize("density", [0.0, 0.1, 0.4, 1.0])
def test_matrices_with_few_and_with_many_zeros(instructions, density):
    """By rows or by columns: the sums of a loop, in its order."""
    bench, random = Bench(), np.random.default_rng(int(10 * density))
    sources = random.permutation(np.r_[bench.layout.source])[:10]
    targets = np.r_[bench.layout.a, bench.layout.memory][:8]
    matrix = random.standard_normal((8, 10)) * (random.random((8, 10)) < density)
    bench.use([Linear(sources, matrix, targets)], [])
    bench.data[bench.layout.source] = random.standard_normal(10)
    bench.u[1] = -0.0
    operands = bench.data.copy()
    expected = []
    for factors in matrix.tolist():
        total = 0.0
        for factor, source in zip(factors, sources, strict=True):
            total += factor * float(operands[source])
        expected.append(total)
    assert bench.by_kernel(instructions)
    assert bench.data[targets].tobytes() == np.array(expected).tobytes()


def test_states_written_before_the_map_come_back_when_the_step_is_refused(instructions):
    bench = Bench()
    bench.use(
        [Product(bench.u[0:2], bench.u[1:3], bench.x[1:3]), Product(bench.u[2:3], bench.u[2:3], bench.memory[0:1])],
        [Delay(bench.y[0:2], bench.memory[10 : 10 + ring_size(2, 3)], 3 * H)],
    )
    bench.x[:] = 0.5
    bench.u[:] = 2.0, 3.0, 4.0
    for _ in range(4):
        assert bench.by_kernel(instructions)
    bench.u[:] = 2.0, 3.0, 1e200  # its square is infinite
    before = bench.data.copy()
    assert not bench.by_kernel(instructions)
    assert bench.data.tobytes() == before.tobytes()
