"""ps-fmu analyse stability of a system of one's own: the verdict comes first; its poles and margins."""

import json
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.analyses.table import ANALYSES
from ps_fmu.cli import main
from ps_fmu.mechanism.parameters import load
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled import LOOP_DELAY

SYSTEM = Path(__file__).parents[2] / "system"


@pytest.fixture
def analyse(built_fmus, tmp_path, capsys):
    def run(*arguments):
        output = tmp_path / "out"
        code = main(["analyse", "stability", "--output", str(output), "--fmus", str(built_fmus), *map(str, arguments)])
        said = capsys.readouterr().out
        assert code == 0
        return said, json.loads((output / "stability.json").read_text())["cases"]

    return run


def test_the_lighter_module_with_the_papers_delay(analyse):
    """The delay that is left, and the slowest pole of the suspension: those of the loop in continuous time."""
    parameters = SYSTEM / "parameters"
    said, cases = analyse("--parameters", parameters / "LSM.ssv", parameters / "delay_20ms.ssv")
    assert "SystemStructure, active: stable. Nearest to the imaginary axis" in said
    left = cases["active"]["margins"]["isolator"]["common"]["delay_s"]
    loop = loop_at(load(bus="LSM"), delay=0.02 + LOOP_DELAY * 1e-4)
    assert left == pytest.approx(loop.delay_limit - loop.delay, abs=2e-4)
    poles = np.array([complex(*pole) for pole in cases["active"]["poles_rad_s"]])
    expected = loop.poles()
    for pole in expected[(expected.imag > 2.0) & (expected.imag < 60.0)]:
        assert np.abs(poles - pole).min() < 2e-3 * abs(pole)


def test_an_unstable_system_is_said_so_first_and_has_no_margins(analyse, ssv):
    said, cases = analyse("--parameters", SYSTEM / "parameters" / "LSM.ssv", ssv({"isolator.delay": 0.1}))
    lines = " ".join(said.split())
    assert lines.startswith("Stability of SystemStructure SystemStructure, passive: stable.")
    assert "SystemStructure, active: UNSTABLE: a pair of poles at +0.4319 +/- 36.09i rad/s (5.745 Hz" in lines
    assert "Without isolator.delay (0.1 s) it is stable" in lines
    assert "Margins of" not in lines
    assert not cases["active"]["stable"]
    assert cases["active"]["margins"] == {}
    assert len(cases["active"]["unstable_poles_rad_s"]) == 4


def test_a_line_of_sight_loop_has_margins_of_its_own(analyse):
    _, cases = analyse("--system", SYSTEM / "LineOfSight.ssd")
    margins = cases["active"]["margins"]["line of sight"]
    assert [axis["axis"] for axis in margins["axes"]] == ["x", "y", "z"]
    assert min(axis["gain_db"] for axis in margins["axes"]) > margins["common"]["gain_db"] > 8.5
    assert cases["passive"]["margins"] == {}
    slow = np.array([complex(*pole) for pole in cases["active"]["poles_rad_s"]])[:6]
    passive = np.array([complex(*pole) for pole in cases["passive"]["poles_rad_s"]])[:6]
    np.testing.assert_allclose(slow, passive, rtol=1e-3)  # modes of the arrays, which no loop moves


def test_the_system_with_all_fmus_is_stable_with_margins(analyse):
    """Voice coils are fast beside the line-of-sight loop: its margins are those without coils, less their delay."""
    loops = {}
    for name in ("LineOfSight", "FullInstrument"):
        _, cases = analyse("--system", SYSTEM / f"{name}.ssd")
        assert cases["passive"]["stable"] and cases["active"]["stable"]
        loops[name] = cases["active"]["margins"]
    full = loops["FullInstrument"]
    assert full["isolator"]["common"]["gain_db"] > 20.0
    assert full["line of sight"]["common"]["gain_db"] > 8.0
    assert full["line of sight"]["common"]["disk"] > 0.75
    ideal, real = (loops[name]["line of sight"]["common"] for name in ("LineOfSight", "FullInstrument"))
    step_s, driver_hz = 1e-4, 1000.0
    late = np.degrees(2.0 * np.pi * real["delay_hz"] * (step_s + 1.0 / (2.0 * np.pi * driver_hz)))
    assert real["phase_deg"] == pytest.approx(ideal["phase_deg"] - late, abs=0.1)


def test_without_a_system_of_ones_own_it_is_the_papers():
    assert ANALYSES["stability"].load().__module__ == "ps_fmu.paper.figures.fig10.report"
    assert ANALYSES["stability"].load(own=True).__module__ == "ps_fmu.trades.stability"
    assert ANALYSES["jitter"].load(own=True) is ANALYSES["jitter"].load()
