"""A core with room for all kinds of elements, and steps on it by the kernel."""

import ctypes
import math

import numpy as np
import pytest

from ps_fmu.numerics.library import find_library
from ps_fmu.slavekit.author.blocks import Matrix, make_blocks, store_by_columns
from ps_fmu.slavekit.author.buffer import BufferLayout
from ps_fmu.slavekit.author.core import Core, Map, make_core
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
    compile_elements,
    ring_size,
)
from ps_fmu.slavekit.author.slave import Port

H = 0.01  # s
N_OUTPUTS, N_STATES, N_INPUTS, N_AUXILIARY, N_MEMORY = 5, 4, 3, 3, 120


def step_by_kernel(instructions: str, core: Core) -> bool:
    """A plain step, by the best instructions if none are named; skips the test where the processor lacks them."""
    answer = find_library().ps_fmu_step_by(instructions.encode(), ctypes.byref(core))
    if answer < 0:
        pytest.skip(f"this processor lacks {instructions}")
    return bool(answer)


def core_of(n_outputs: int, n_states: int, n_inputs: int) -> tuple[Core, np.ndarray]:
    """A core and its buffer ``[y|x|u]``."""
    ports = [Port(f"y_{i}", "output") for i in range(n_outputs)] + [Port(f"u_{i}", "input") for i in range(n_inputs)]
    layout = BufferLayout("sizes", "1", ports, n_states, 0, 0)
    data = np.zeros(layout.size)
    return make_core(layout, data), data[: layout.memory.start]


def make_dense(by_columns: np.ndarray) -> Matrix:
    """A matrix by columns as one block of all rows and columns."""
    n, stride = by_columns.shape
    return Matrix(by_columns, np.array([[0, stride, 0, n, 0]]), np.arange(n, dtype=np.int32), by_columns.reshape(-1))


def use_matrix(core: Core, matrix: np.ndarray, *, dense: bool = False) -> None:
    """A plain step is the product with this matrix, in blocks or as a whole."""
    make = make_dense if dense else make_blocks
    core.use_maps(Map.make(make(store_by_columns(matrix)), core.source, core.arrays["target"]))


class Bench:
    """A core with room for all kinds of elements, and what takes part of its buffer."""

    def __init__(self, seed: int = 0) -> None:
        ports = [Port(f"y_{i}", "output") for i in range(N_OUTPUTS)]
        ports += [Port("flag", "output", type="Boolean")]
        ports += [Port(f"u_{i}", "input") for i in range(N_INPUTS)] + [Port("p", "parameter")]
        self.layout = BufferLayout("bench", "1", ports, N_STATES, N_AUXILIARY, N_MEMORY)
        self.data = np.zeros(self.layout.size)
        self.core: Core = make_core(self.layout, self.data)
        self.core.step = H
        parts = ("y", "x", "u", "a", "memory")
        self.y, self.x, self.u, self.a, self.memory = (self.data[getattr(self.layout, p)] for p in parts)
        self.random = np.random.default_rng(seed)
        self.taken = 0
        shape = self.layout.target.stop, self.layout.source.stop - self.layout.source.start
        self.matrix = self.random.standard_normal(shape) * self.random.choice([0.0, 0.3], shape)
        use_matrix(self.core, self.matrix)
        self.core.watching = 0

    def keep(self, n: int) -> np.ndarray:
        """Memory that nothing else uses."""
        self.taken += n
        assert self.taken <= N_MEMORY
        return self.memory[self.taken - n : self.taken]

    def use(self, before: list[Element], after: list[Element]) -> None:
        self.core.use_elements(compile_elements(self.layout, self.data, before, after))

    def by_kernel(self, instructions: str) -> bool:
        return step_by_kernel(instructions, self.core)

    def random_operand(self, n: int, *, written: bool) -> np.ndarray:
        """A view, or places in any order; of memory, what no element keeps."""
        views = [self.y, self.x, self.a, self.memory[-6:], *(() if written else (self.u,))]
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
        if choice in (0, 8, 9) and self.taken + 1 + ring_size(n, 5) > N_MEMORY - 6:
            choice = 7
        match choice:
            case 0:
                return Sample(value, target, self.keep(1), every * H)
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
                return Hold(target, self.keep(n), self.keep(1), every * H)
            case 9:
                return Delay(target, self.keep(ring_size(n, 5)), int(random.integers(0, 6)) * H)
            case 10:
                return Watch(value, other, np.abs(some[0]))
            case _:
                return (
                    Count(value, np.abs(some[0]), self.keep(2 * n), target[: random.choice([1, n])])
                    if (self.taken + 2 * n <= N_MEMORY - 6)
                    else Product(value, other, target)
                )


def run(bench: Bench, n: int = 1) -> None:
    """Steps by the kernel, which has to make them."""
    step = bench.core.make_step()
    for _ in range(n):
        assert step()
        bench.core.count += 1


def make_quiet_bench() -> Bench:
    """A bench whose map copies the inputs to the first outputs, and does nothing else."""
    found = Bench()
    matrix = np.zeros((found.layout.target.stop, 7))
    matrix[:3, 4:7] = np.eye(3)  # u after the four states; the columns of a and r are left out
    use_matrix(found.core, matrix)
    return found
