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


@pytest.mark.parametrize(
    ("start", "step", "missed"),
    [(0.8, 8.0, []), (3.1, 8.0, ["start with 4032", "start per connection"]), (0.8, 13.0, ["connection: 1.65 times"])],
)
def test_what_is_missed_of_many_connections_is_named(start, step, missed, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    import many_fmus

    texts = many_fmus.find_missed({512: (0.2, 1.0), 1024: (9.0, 9.0), 4032: (start, step)})
    assert len(texts) == len(missed)
    assert all(word in text for word, text in zip(missed, texts, strict=True))
