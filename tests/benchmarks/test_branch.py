"""The benchmark of studies from a checkpoint measures its three kinds of cases, and reports."""

import importlib.util
import json
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture
def benchmark_of_branches(monkeypatch):
    path = ROOT / "benchmarks" / "branch.py"
    spec = importlib.util.spec_from_file_location("benchmark_of_branches", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


def test_three_kinds_of_cases_are_measured_and_reported(benchmark_of_branches, built_fmus, tmp_path, capsys):
    words = ["--rounds", "1", "--settling", "0.02", "--duration", "0.01", "--output", str(tmp_path / "found.json")]
    assert benchmark_of_branches.main(words) == 0
    found = json.loads((tmp_path / "found.json").read_text())
    assert [*found] == ["from a checkpoint", "cold", "cold, with settling"]
    assert all(seconds > 0.0 and ratio > 0.0 for seconds, ratio in found.values())
    assert found["from a checkpoint"][1] == 1.0
    assert "cold, with settling" in capsys.readouterr().out
