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


def test_all_ways_are_measured_and_reported(benchmark_of_checkpoints, built_fmus, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(benchmark_of_checkpoints, "INTERVAL", 0.05)
    words = ["--rounds", "1", "--duration", "0.2", "--output", str(tmp_path / "found.json")]
    for most, code in ((1e9, 0), (0.0, 1)):
        monkeypatch.setattr(benchmark_of_checkpoints, "MOST", most)
        assert benchmark_of_checkpoints.main(words) == code
    found = json.loads((tmp_path / "found.json").read_text())
    assert found.keys() == {"interval_s", "wall", "processor", "loop"}
    for clock in ("wall", "processor", "loop"):
        assert [found[clock][way]["checkpoints"] for way in ("without", "all")] == [0, 4]
        assert 2 <= found[clock]["paid"]["checkpoints"] <= 4
        assert all(way["s"] > 0.0 and way["ratio"] > 0.0 for way in found[clock].values())
    printed = capsys.readouterr()
    assert "of 4 checkpoints that fall due" in printed.out
    assert "expected at most" in printed.err
