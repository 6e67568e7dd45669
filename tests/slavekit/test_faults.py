"""Mistakes of a host neither crash the process nor use up its memory."""

import subprocess
import sys
from pathlib import Path

HOST = Path(__file__).parent / "hosts" / "faults.py"


def test_hundreds_of_faults_at_every_entry_point(built, make):
    run = subprocess.run(
        [sys.executable, str(HOST), str(built["oscillator"]), "300"], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr[-3000:]
    growth, position = run.stdout.split()[-2:]
    assert int(growth) < 1000  # kB, over 2500 faults
    slave = make("oscillator", reference=0.0)
    slave.set_real([slave.layout.find("reference")], [0.5])
    for i in range(10):
        assert slave.do_step(i * 0.1, 0.1)
    assert float(position) == slave.value("position")
    assert "input force = nan: expected a finite number N" in run.stderr
    assert "reference = 2.0 m: expected at most 1 m" in run.stderr
