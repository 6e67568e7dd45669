"""The benchmark of the observers measures them all in a run, and each."""

import importlib.util
import sys
from pathlib import Path

import pytest

from ps_fmu.cosim import read_system

ROOT = Path(__file__).parents[2]


@pytest.fixture
def benchmark_of_observers(monkeypatch):
    path = ROOT / "benchmarks" / "observers.py"
    monkeypatch.syspath_prepend(str(path.parent))
    spec = importlib.util.spec_from_file_location("benchmark_of_observers", path)
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, spec.name, module)
    spec.loader.exec_module(module)
    return module


def test_all_observers_are_measured_and_reported(benchmark_of_observers, built_fmus, tmp_path):
    system = read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus)
    result = benchmark_of_observers.measure(system, 1, tmp_path, duration=0.3)
    ways = ["none", "in the loop", "beside"]
    assert [list(result[clock]) for clock in ("processor", "loop", "wall")] == [ways] * 3
    assert list(result["each"]) == ["Bounds", "Recorder", "Batch", "LastRow", "IndexRecord"]
    assert all(cost > 0.0 for costs in result.values() for cost in costs.values())
    text = benchmark_of_observers.report(result)
    assert "beside, to steps" in text
    assert "Recorder" in text
    assert not list(tmp_path.iterdir())
