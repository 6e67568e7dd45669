"""The benchmark runs: all contenders compute the same, and every figure is there.  How fast is not tested."""

import json
import subprocess
import sys
from pathlib import Path

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "step_cost.py"


def test_one_round(built_fmus: Path, tmp_path: Path) -> None:
    output = tmp_path / "step_cost.json"
    run = subprocess.run(
        [sys.executable, SCRIPT, "--rounds", "1", "--output", output], capture_output=True, text=True, timeout=240
    )
    assert "Traceback" not in run.stderr, run.stderr
    found = json.loads(output.read_text())
    assert run.returncode == (1 if "MISSED" in run.stderr else 0)
    in_c = {"C FMUs", "C FMUs, structured", "C FMUs, synthesis", "ours, no synthesis"}
    contenders = {"ours", "ours, loop in Python", "stock", "textbook", "libcosim", "Ecos"} | in_c
    assert set(found["median_us"]) == contenders
    assert set(found["us_per_call"]) == {"disturbance", "commander", "plant", "isolator"}
    assert set(found["us_per_fmpy_call_of_30_reals"]["ours"]) == {"set", "get"}
    assert min(found["two_threads"]["ours"], found["two_threads"]["c_fmus"], found["ours_to_c_fmus"]) > 0.0
    assert min(found["ours_to_structured_c_fmus"], found["mean_to_c_fmus"], found["mean_to_c_fmus_with_table"]) > 0.0
    assert len(found["us_per_call_in_c_host"]) == 3
    assert all(min(ways.values()) > 0.0 for ways in found["us_per_call_in_c_host"].values())
    assert found["all_fmus_to_four"] > 0.0
    assert all(0.0 < row["mean"] <= row["longest"] for row in found["us_per_single_step"].values())
    assert found["us_of_reference"] > 0.0
    assert "x real time" in run.stdout


def test_impossible_number_of_rounds() -> None:
    run = subprocess.run([sys.executable, SCRIPT, "--rounds", "0"], capture_output=True, text=True, timeout=300)
    assert run.returncode == 2
    assert "--rounds: expected at least 1" in run.stderr
