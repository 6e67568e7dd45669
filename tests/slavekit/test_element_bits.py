"""Random programs of elements: the same bits in Python and by the launcher's kernels."""

import numpy as np
import pytest
from support.bench import N_INPUTS, Bench

from ps_fmu.slavekit.author.core import OutputLimits
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
