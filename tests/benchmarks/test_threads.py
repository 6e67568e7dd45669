"""Which rounds of the benchmark of two threads count."""

from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize(
    ("ours", "c_fmus", "found", "is_judged"),
    [
        ([1.5, 1.0, 1.6, 1.7], [1.95, 1.92, 1.94, 1.91, 1.99], (1.55, 1.915, 4), True),  # bad rounds of ours count
        ([1.5, 1.0, 1.6, 1.7], [1.95, 1.0, 1.94, 1.91, 1.99], (1.65, 1.91, 2), False),
        ([1.9, 1.8, 1.0], [1.0, 1.95, 1.1, 1.95], (1.8, 1.1, 0), False),  # one core, before or after
        ([1.2], [1.95, 1.95], (1.2, 1.95, 1), True),
    ],
)
def test_rounds_count_in_which_c_fmus_had_both_cores(ours, c_fmus, found, is_judged, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import threads

    throughput = threads.choose_rounds(ours, c_fmus)
    assert (throughput.ours, throughput.c_fmus, throughput.free) == pytest.approx(found)
    assert throughput.is_judged == is_judged
