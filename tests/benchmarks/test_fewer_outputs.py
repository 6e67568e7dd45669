"""The script that measures what outputs cost prints a row for each choice."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]


def test_fewer_columns_are_read_with_each_choice() -> None:
    script = [sys.executable, ROOT / "benchmarks" / "fewer_outputs.py", "--rounds", "1", "--steps", "20"]
    run = subprocess.run(script, capture_output=True, text=True, timeout=240, check=True)
    columns = [int(row[1]) for row in re.finditer(r"\.ssd +\w+ +(\d+) +[\d.]+ +[\d.]+$", run.stdout, re.MULTILINE)]
    assert len(columns) == 6
    assert columns[0] > columns[1] > columns[2]
    assert columns[3] > columns[4] > columns[5]
