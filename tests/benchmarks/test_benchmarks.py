"""The benchmarks run, on few steps, and every figure is there.  How fast anything is, is not tested."""

import json
import math
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SCRIPTS = {
    "step_cost": ("--steps 20", {"median_us", "ratios"}),
    "start": (
        '--resets 40 --masters 15 --commands "isolation, 1 s, without figures"', {"commands_s", "starts_s", "growth"},
    ),
    "scaling": ("--steps 20", {"fmus", "connections", "threads"}),
    "study": ('--cases 2 --duration 0.01 --settling 0.02 --studies "from a checkpoint"', {"from a checkpoint"}),
    "features": ("--steps 8", {"plain", "observers", "two C FMUs, isolated", "scheme: error estimate"}),
    "real_time": ('--steps 200 --runs plant "isolator, delay"', {"us"}),
}
"""Script -> options, and some of the names of its figures."""


def list_numbers(found):
    if not isinstance(found, dict | list):
        return [found]
    values = found.values() if isinstance(found, dict) else found
    return [number for value in values for number in list_numbers(value)]


@pytest.mark.parametrize("script", SCRIPTS)
def test_every_figure_is_there(script, built_fmus, tmp_path):
    options, names = SCRIPTS[script]
    output = tmp_path / "found.json"
    command = [sys.executable, BENCHMARKS / f"{script}.py", "--rounds", "1", "--output", output, *shlex.split(options)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=240)
    assert "Traceback" not in done.stderr, done.stderr
    assert done.returncode == (1 if "MISSED" in done.stderr else 0)
    found = json.loads(output.read_text())
    assert names <= found.keys()
    assert all(math.isfinite(number) for number in list_numbers(found))
    if script == "start":
        expect_nothing_left(found["growth"])
    if script == "real_time":
        assert [row["in Python"] for row in found["us"].values()] == [0.0, 0.0]


def expect_nothing_left(growth):
    """Nothing grows with the number of starts."""
    assert set(growth) == {"resets", "new Masters"}
    for counts in growth.values():
        grown = {name: values[-1] - values[0] for name, values in counts.items()}
        assert grown["memory (kB)"] < 6000  # one Master left this much behind when each unpacked and loaded anew
        assert grown["mappings"] < 20
        assert grown["descriptors"] == 0
        assert grown["files"] == 0


def test_a_limit_that_is_missed_is_named(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    from rounds import Limit, compare

    most = Limit("cost", lambda found: found["cost"], 2.0)
    least = Limit("speed", lambda found: found["cost"], 2.0, at_least=True)
    assert [limit.find_missed({"cost": 2.0}) for limit in (most, least)] == [None, None]
    assert most.find_missed({"cost": 2.5}) == "MISSED: cost: 2.5; at most 2 wanted"
    assert least.find_missed({"cost": 1.5}) == "MISSED: speed: 1.5; at least 2 wanted"
    assert Limit("none", lambda found: None, 1.0).find_missed({}) is None
    assert compare({"a": [2.0, 9.0, 6.0], "b": [1.0, 1.0, 2.0]}, "a", "b") == 3.0


def test_the_page_has_what_was_measured(monkeypatch):
    """docs/developers/speed.md is what its command makes of the record: no figure in it is written by hand."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.syspath_prepend(str(BENCHMARKS.parent / "docs"))
    from rounds import RECORD
    from write_speed import PAGE, SECTIONS, make_page

    record = json.loads(RECORD.read_text())
    assert record.keys() <= SECTIONS.keys() == SCRIPTS.keys()
    assert make_page(record) == PAGE.read_text(), "make it again: .venv/bin/python docs/write_speed.py"
    record["real_time"]["found"]["us"]["plant"]["mean"] = 1.25
    assert "| real_time | us per step of an FMU in steady motion | 1.25 | at most 1 | missed |" in make_page(record)


def test_impossible_number_of_rounds():
    command = [sys.executable, BENCHMARKS / "step_cost.py", "--rounds", "0"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 2
    assert "--rounds: expected at least 1" in done.stderr
