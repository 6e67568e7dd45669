"""The manipulator on a hub of Basilisk, where that is installed: `make basilisk`."""

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from support.importers import python_with_basilisk

FLY = Path(__file__).parents[2] / "examples" / "basilisk" / "fly.py"


def fly(case: str, duration: float, fmus: Path, output: Path) -> dict[str, Any]:
    python = python_with_basilisk()
    command = [str(python), str(FLY), case, "--duration", str(duration), "--fmus", str(fmus)]
    done = subprocess.run([*command, "--output", str(output)], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr[-2000:]
    return json.loads((output / f"{case}.json").read_text())


def test_hub_and_payload_move_as_on_the_own_bus(built_fmus: Path, tmp_path: Path) -> None:
    """Mounted apart from the hub's origin, and turned."""
    errors = fly("compare", 0.2, built_fmus, tmp_path)["of_the_largest_value"]
    fine = {step: np.array(found[:3]) for step, found in errors.items()}
    assert fine["0.0001"].max() < 1e-4
    assert np.median(fine["0.0004"] / fine["0.0001"]) > 4.0
    assert max(errors["0.0001"]) < 2e-4


def test_momentum_is_kept(built_fmus: Path, tmp_path: Path) -> None:
    found = fly("momentum", 2.0, built_fmus, tmp_path)
    angular, change = np.array(found["angular momentum, N.m.s"]), np.array(found["its change"])
    assert np.abs(change).max() < 1e-4 * np.linalg.norm(angular)


@pytest.mark.parametrize("duration", [6.0])
def test_a_slew_begins_with_the_isolator_on(duration: float, built_fmus: Path, tmp_path: Path) -> None:
    found = fly("slew", duration, built_fmus, tmp_path)
    off, on = found["isolator off"], found["isolator on"]
    assert on["hub angle, deg"] == pytest.approx(off["hub angle, deg"], rel=1e-3)
    assert on["hub angle, deg"] > 1.0
    assert (tmp_path / "slew.png").stat().st_size > 10_000
