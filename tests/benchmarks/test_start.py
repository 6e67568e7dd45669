"""Nothing grows with the number of starts: a few of them, measured as ``benchmarks/growth.py`` does many."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_starts_leave_nothing_behind(built_fmus, tmp_path):
    command = [sys.executable, str(ROOT / "benchmarks" / "growth.py"), "40", "15", "--json"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    found = json.loads(run.stdout)
    assert set(found) == {"resets", "new Masters"}
    for counts in found.values():
        grown = {name: values[-1] - values[0] for name, values in counts.items()}
        assert grown["memory (kB)"] < 6000  # one Master left this much behind when each unpacked and loaded anew
        assert grown["mappings"] < 20
        assert grown["descriptors"] == 0
        assert grown["files"] == 0
    assert list(tmp_path.iterdir()) == []
