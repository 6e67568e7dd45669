"""Maps in blocks: the same bits as the dense matrix, by all kernels, and split maps of models."""

import ctypes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.bench import core_of, step_by_kernel, use_matrix
from support.states import start_stepping

from ps_fmu.numerics.library import find_library
from ps_fmu.slavekit.author.blocks import make_blocks, store_by_columns
from ps_fmu.slavekit.author.core import Core, Map
from ps_fmu.slavekit.author.slave import Port, Slave

WAYS = ["sse2", "avx2", "avx512"]


@st.composite
def sparse_matrices(draw: st.DrawFn) -> np.ndarray:
    """Rectangles of random numbers on zeros: empty rows and columns, overlaps, all zeros, all full."""
    m, n = draw(st.integers(1, 90)), draw(st.integers(1, 40))
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    matrix = np.zeros((m, n))
    for _ in range(draw(st.integers(0, 5))):
        rows, columns = (np.sort(random.integers(0, size + 1, 2)) for size in (m, n))
        shape = int(np.diff(rows)[0]), int(np.diff(columns)[0])
        matrix[rows[0] : rows[1], columns[0] : columns[1]] = random.standard_normal(shape)
    if draw(st.booleans()):
        matrix *= random.random((m, n)) < 0.3
    if draw(st.booleans()):
        matrix[:] = random.standard_normal((m, n)) * 10.0 ** random.integers(-12, 12, (m, n))
    return matrix


@settings(max_examples=60, deadline=None)
@given(sparse_matrices(), st.integers(0, 2**32), st.sampled_from(WAYS))
def test_blocks_have_the_bits_of_the_dense_matrix(matrix: np.ndarray, seed: int, way: str):
    step = find_library().ps_fmu_step_by
    m, n = matrix.shape
    core, data = core_of(m, 0, n)
    random = np.random.default_rng(seed)
    data[:] = random.standard_normal(data.size) * random.choice([0.0, -0.0, 1.0, 1e-9], data.size)
    before, found = data.copy(), []
    for dense in (True, False):
        use_matrix(core, matrix, dense=dense)
        for instructions in ("", way):
            data[:] = before
            if step(instructions.encode(), ctypes.byref(core)) == -1:  # this processor lacks the instructions
                continue
            found.append(data.tobytes())
    assert len(found) >= 2
    assert len(set(found)) == 1


@settings(max_examples=100, deadline=None)
@given(sparse_matrices())
def test_blocks_cover_each_row_once_and_each_number(matrix: np.ndarray):
    by_columns = store_by_columns(matrix)
    made = make_blocks(by_columns)
    rebuilt, next_row = np.zeros_like(by_columns), 0
    for row, n_rows, column, n_columns, number in made.blocks.tolist():
        assert row == next_row
        next_row += n_rows
        columns = made.columns[column : column + n_columns]
        assert (np.diff(columns) > 0).all()
        numbers = made.numbers[number : number + n_columns * n_rows]
        rebuilt[columns, row : row + n_rows] = numbers.reshape(n_columns, n_rows)
    assert next_row == by_columns.shape[1]
    np.testing.assert_array_equal(rebuilt, by_columns)
    assert made.numbers.size <= by_columns.size


def test_zeros_are_left_out():
    """Two blocks of 16 rows and 20 columns on the diagonal of 40 columns: half of the dense product."""
    matrix = np.zeros((32, 40))
    matrix[:16, :20] = matrix[16:, 20:] = 1.0
    made = make_blocks(store_by_columns(matrix))
    assert made.blocks[:, [1, 3]].tolist() == [[16, 20], [16, 20]]
    assert made.numbers.size == matrix.size // 2
    assert make_blocks(store_by_columns(np.zeros((32, 40)))).numbers.size == 0


def two_maps(first: list[list[float]], second: list[list[float]]) -> tuple[Core, np.ndarray]:
    """One output, one state, one input: x by the first map, then y by the second."""
    core, data = core_of(1, 1, 1)
    states, outputs = (make_blocks(store_by_columns(np.array(matrix))) for matrix in (first, second))
    core.use_maps(Map.make(states, core.source, data[1:2]), Map.make(outputs, core.source, data[:1]))
    return core, data


@pytest.mark.parametrize("way", WAYS)
def test_the_second_map_reads_what_the_first_has_written(way):
    core, data = two_maps([[0.5, 1.0]], [[10.0, 100.0]])
    data[:] = 7.0, 4.0, 1.0
    assert step_by_kernel(way, core)
    assert data.tolist() == [130.0, 3.0, 1.0]


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize(("first", "second"), [([[1e200, 0.0]], [[1.0, 0.0]]), ([[0.5, 0.0]], [[1e300, 0.0]])])
def test_a_map_that_is_not_finite_takes_back_the_others(way, first, second):
    core, data = two_maps(first, second)
    data[:] = 7.0, 1e200, 1.0
    assert not step_by_kernel(way, core)
    assert data.tolist() == [7.0, 1e200, 1.0]


# --- Models -----------------------------------------------------------------------------


class Model(Slave):
    """y = 1.5 x + 4 u; x <- 0.5 x + u."""

    ports = (Port("y", "output"), Port("u", "input"), Port("fault", "parameter"))
    n_states = 1

    def configure(self):
        self.y[:] = self.x[:] = 0.0

    def step_map(self, h):
        whole = np.array([[1.5, 4.0], [0.5, 1.0]])
        match self.value("fault"):
            case 1.0:
                return whole[:1]
            case 2.0:
                whole[1] = 1e308
        return whole


def begin(fault: float = 0.0) -> Slave:
    slave = Model(instance_name="m")
    slave.set_real([slave.layout.reference["fault"]], [fault])
    start_stepping(slave)
    slave.set_real([slave.layout.reference["u"]], [8.0])
    return slave


def test_a_map_of_the_wrong_shape_is_named():
    with pytest.raises(ValueError, match=r"Model\.step_map is of shape \(1, 2\); expected \(2, 2\)"):
        begin(fault=1.0).do_step(0.0, 0.1)


def test_a_state_that_is_not_finite_is_named():
    slave = begin(fault=2.0)
    with pytest.raises(Exception, match="not finite: state 0; largest operand 8"):
        slave.do_step(0.0, 0.1)
    assert (slave.y.tolist(), slave.x.tolist()) == ([0.0], [0.0])
