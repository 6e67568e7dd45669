"""The benchmark of large systems runs, on small ones."""

import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_rings_of_one_and_two():
    command = [sys.executable, str(BENCHMARKS / "scaling.py"), "1", "2", "--repeats", "1"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    rows = [line.split() for line in run.stdout.splitlines()[1:]]
    assert [(int(row[0]), int(row[1])) for row in rows] == [(1, 63), (2, 126)]
    assert all(float(value) > 0.0 for row in rows for value in row[2:])


@pytest.mark.parametrize(
    ("step", "start", "missed"),
    [(64.0, 1.0, []), (64.0 * 1.7, 1.0, ["a step per FMU"]), (64.0, 3.1, ["start of 64"])],
)
def test_what_is_missed_is_named(step, start, missed, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import scaling

    texts = scaling.find_missed({1: scaling.Cost(0.1, 9.0), 4: scaling.Cost(0.1, 4.0), 64: scaling.Cost(start, step)})
    assert len(texts) == len(missed)
    assert all(word in text for word, text in zip(missed, texts, strict=True))
