"""The benchmark of isolation runs, and tells a target that is missed."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_a_few_steps():
    command = [sys.executable, str(BENCHMARKS / "isolation.py"), "--rounds", "2", "--steps", "20"]
    run = subprocess.run(command, capture_output=True, text=True)
    rows = [line.split() for line in run.stdout.splitlines()[1:]]
    assert [row[0] for row in rows] == ["inside", "isolated"], run.stderr
    assert all(float(value) > 0.0 for row in rows for value in row[1:])


@pytest.mark.parametrize(("isolated", "missed"), [(17.9, []), (18.1, ["isolation: 15.1 us a step, 15 are the target"])])
def test_what_is_missed_is_named(isolated, missed, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import isolation

    assert isolation.find_missed({"inside": [3.0, 1.0, 9.0], "isolated": [isolated, 0.0, 99.0]}) == missed
