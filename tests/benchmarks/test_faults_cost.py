"""The benchmark of faults runs, on a few steps."""

import subprocess
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_each_kind_is_measured(built_fmus):
    command = [sys.executable, str(BENCHMARKS / "faults.py"), "--steps", "100", "--repeats", "1"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()[1:]
    assert [line[:24].strip() for line in lines] == [
        "none", "bias", "delay of 100 steps", "noise", "noise on ten signals"
    ]  # fmt: skip
    assert all(float(value) > 0.0 for line in lines for value in line[24:].split())
