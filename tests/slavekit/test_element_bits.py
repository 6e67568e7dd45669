"""Random programs of elements: the same bits in Python and by the launcher's kernels."""

import numpy as np
import pytest
from support.bench import N_INPUTS, Bench, H

from ps_fmu.slavekit.author.core import OutputLimits
from ps_fmu.slavekit.author.elements import Delay, Linear, Product, ring_size
from ps_fmu.slavekit.author.plain import make_plain_step


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


@pytest.mark.parametrize("density", [0.0, 0.1, 0.4, 1.0])
def test_matrices_with_few_and_with_many_zeros(instructions, density):
    """By rows or by columns, in Python and by the kernels: the sums of a loop, in its order."""
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
    before = bench.data.copy()
    assert bench.by_kernel(instructions)
    found = bench.data.copy()
    assert found[targets].tobytes() == np.array(expected).tobytes()
    bench.data[:] = before
    assert make_plain_step(bench.core)()
    assert bench.data.tobytes() == found.tobytes()


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
