"""The documentation states how many multiplications the maps take, as the script counts them."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"\| (\w+) \| (\d+) \| (\d+) \| (\d+) \| ([\d.]+) \| ([\d.]+) \|")


def read_rows(text: str) -> dict[str, list[float]]:
    return {row[1]: [float(value) for value in row.groups()[1:]] for row in ROW.finditer(text)}


def test_documented_counts() -> None:
    script = ROOT / "benchmarks" / "map_sizes.py"
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=240, check=True)
    counted, stated = read_rows(run.stdout), read_rows((ROOT / "docs" / "slavekit.md").read_text())
    assert counted.keys() == stated.keys()
    for model, numbers in counted.items():
        assert stated[model] == pytest.approx(numbers, rel=0.02, abs=0.05), model  # zeros depend on the BLAS library
    assert counted["ManipulatorPlant"][2] < 0.5 * counted["ManipulatorPlant"][0]
