import numpy as np
import pytest

from ps_fmu.cosim import Column
from ps_fmu.runs.cases import Bounds, Divergence, show_progress


def test_values_beyond_all_use_end_a_run():
    """Not only those of the last column, and not those that are merely large."""
    bounds = Bounds((Column("plant.a", "m", "Real", ""), Column("plant.b", "N", "Real", "")))
    values = np.full((3, 2), 1e99)
    bounds.block(0, np.arange(3.0), values)
    values[1:, 0] = -1e101
    with pytest.raises(Divergence, match=r"plant\.a is beyond 1e\+100 m at t = 1 s: .* unstable loop"):
        bounds.block(0, np.arange(3.0), values)


@pytest.mark.parametrize("shown", [True, False])
def test_progress_bar(capsys, shown):
    with show_progress("passive", 20.0, shown) as advance:
        advance(10.0, 2.0, 5.0)
        advance(20.0, 4.0, 5.0)
    text = capsys.readouterr().err
    assert ("passive: 100%" in text) == shown
    assert ("5.0 x real time" in text) == shown


def test_no_progress_bar_without_an_error_stream(monkeypatch):
    monkeypatch.setattr("sys.stderr", None)
    with show_progress("passive", 20.0, True) as advance:
        advance(10.0, 2.0, 5.0)
