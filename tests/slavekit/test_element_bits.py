"""Random programs of elements: the bits of their definitions, whatever the processor."""

import numpy as np
import pytest
from support.bench import N_INPUTS, Bench, H
from support.defined_step import DefinedStep

from ps_fmu.slavekit.author.core import OutputLimits
from ps_fmu.slavekit.author.elements import Delay, Linear, Product, ring_size


@pytest.fixture(params=["sse2", "avx2", "avx512"])
def instructions(request) -> str:
    return request.param


@pytest.mark.parametrize("seed", range(25))
def test_random_programs_do_what_their_elements_say(instructions, seed):
    """All or nothing as well: some steps are refused for an input that is too large, or for a number that overflows."""
    bench = Bench(seed)
    before, after = ([bench.random_element() for _ in range(bench.random.integers(6))] for _ in range(2))
    bench.use(before, after)
    limit = 1e3 if seed % 2 else np.inf
    bench.core.use_limits(OutputLimits(np.full(6, -limit), np.full(6, limit), 5) if seed % 2 else None)
    definition = DefinedStep(bench, before, after, limit)
    inputs = np.random.default_rng(seed)
    outcomes = set()
    for k in range(60):
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
        outcomes.add(done)
    assert True in outcomes


@pytest.mark.parametrize("density", [0.0, 0.1, 0.4, 1.0])
def test_matrices_with_few_and_with_many_zeros(instructions, density):
    """By rows or by columns: the sums of a loop, in its order."""
    bench, random = Bench(), np.random.default_rng(int(10 * density))
    sources = random.permutation(np.r_[bench.layout.source])[:10]
    targets = np.r_[bench.layout.a, bench.layout.memory][:8]
    matrix = random.standard_normal((8, 10)) * (random.random((8, 10)) < density)
    bench.use([Linear(sources, matrix, targets)], [])
    bench.data[bench.layout.source] = random.standard_normal(12)
    bench.u[1] = -0.0
    operands = bench.data.copy()
    operands[bench.layout.r] = bench.core.arrays["table"][0]
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
