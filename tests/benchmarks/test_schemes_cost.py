"""The benchmark of schemes runs, on a few steps."""

import subprocess
import sys
from pathlib import Path

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_each_scheme_is_measured_with_a_fault_and_without(built_fmus):
    command = [sys.executable, str(BENCHMARKS / "schemes.py"), "--steps", "8", "--repeats", "1"]
    run = subprocess.run(command, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    lines = run.stdout.splitlines()[1:]
    assert [line[24:38].strip() for line in lines] == ["", "with a fault"] * 7
    assert lines[-1].startswith("jacobi, error estimate")
    assert all(float(value) > 0.0 for line in lines for value in line[38:].split())
