"""The benchmark of checkpoints measures runs without and with them, and reports."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def benchmark_of_checkpoints(monkeypatch):
    path = ROOT / "benchmarks" / "checkpoint.py"
    spec = importlib.util.spec_from_file_location("benchmark_of_checkpoints", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


def test_both_runs_are_measured_and_reported(benchmark_of_checkpoints, built_fmus, tmp_path, capsys):
    words = ["--rounds", "1", "--duration", "0.2", "--output", str(tmp_path / "found.json")]
    assert benchmark_of_checkpoints.main(words) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert found.keys() == {"interval_s", "wall", "processor", "loop"}
    assert all(seconds > 0.0 for clock in ("wall", "processor", "loop") for seconds in found[clock])
    assert "processor" in capsys.readouterr().out
