"""Nothing grows with the number of starts: a few of them, measured as ``benchmarks/start.py`` does many."""

import json
import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_starts_leave_nothing_behind(built_fmus, tmp_path):
    command = [sys.executable, str(ROOT / "benchmarks" / "start.py"), "--child", "growth", str(ROOT), "40", "15"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    run = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
    for grown in json.loads(run.stdout).values():
        assert grown["memory (kB)"] < 6000  # one Master left this much behind when each unpacked and loaded anew
        assert grown["mappings"] < 20
        assert grown["descriptors"] == 0
        assert grown["files"] == 0
    assert list(tmp_path.iterdir()) == []
