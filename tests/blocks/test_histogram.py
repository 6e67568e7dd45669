"""Values are counted in the bins that their edges say, compiled and in numpy."""

import numpy as np
import pytest

from ps_fmu.blocks import histogram
from ps_fmu.blocks.histogram import LogarithmicBins

BINS = LogarithmicBins(-3, 2, 2000)


def test_c_and_numpy_agree_on_all_edges_and_beside_them(monkeypatch):
    edges = BINS.edges[:-1]
    beside = [np.nextafter(edges, 0.0), edges, np.nextafter(edges, np.inf)]
    rest = 10.0 ** np.random.default_rng(2).uniform(-9.0, 5.0, 20_000)
    values = np.concatenate([*beside, rest, [0.0, 5e-324, 1e300, np.inf]])
    counts = [np.zeros(len(BINS.edges), dtype=np.int64) for _ in range(2)]
    BINS.count(values, 1.0, counts[0])
    assert histogram.find_library() is not None
    monkeypatch.setattr(histogram, "find_library", lambda: None)
    BINS.count(values, 1.0, counts[1])
    np.testing.assert_array_equal(*counts)
    assert counts[0].sum() == len(values)


@pytest.mark.parametrize("compiled", [True, False])
def test_a_value_lies_below_the_edge_of_its_bin_or_on_it(compiled, monkeypatch):
    if not compiled:
        monkeypatch.setattr(histogram, "find_library", lambda: None)
    for value in (0.0, 1e-3, 0.5, 1.0, 99.9, 100.0, 101.0):
        counts = np.zeros(len(BINS.edges), dtype=np.int64)
        BINS.count(np.array([value]) * 3.0, 3.0, counts)
        (place,) = np.flatnonzero(counts)
        assert value <= BINS.edges[place] and (place == 0 or value > BINS.edges[place - 1])


def test_counts_of_another_shape_are_refused():
    with pytest.raises(ValueError, match="counts: expected 10002 contiguous int64"):
        BINS.count(np.ones(3), 1.0, np.zeros(7, dtype=np.int64))
