"""ps-fmu analyse stability."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.analyses.options import AnalysisOptions
from ps_fmu.paper.bus_cases import CASES, load_case
from ps_fmu.paper.figures.fig10.closed_form import judge
from ps_fmu.paper.figures.fig10.report import analyse
from ps_fmu.paper.published import published_numbers
from ps_fmu.runs.scenario import SCENARIOS
from ps_fmu.scenarios.shaking import Shaking

SYSTEM = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
STEP = 1e-3  # s
SCENARIO = replace(SCENARIOS["stability"], duration_s=3.0, step_s=STEP)
SHORT = Shaking(half_period=5.0, settling=15.0, band=(2.0, 30.0), step=STEP, stride=2)


@pytest.fixture(scope="module")
def runs(built_fmus, tmp_path_factory):
    """The analysis with short runs in long steps: its options, and the content of its JSON."""
    options = AnalysisOptions(tmp_path_factory.mktemp("stability"), built_fmus, SYSTEM, progress=False)
    analyse(options, SCENARIO, SHORT).write(options.output)
    return options, json.loads((options.output / "stability.json").read_text())


def test_findings_in_closed_form(runs):
    found = {finding["key"]: finding for finding in runs[1]["findings"]}
    assert found["fig10.LSM_phase_margin"]["computed"] == pytest.approx(-25.97, abs=0.01)
    assert found["fig10.LSM_phase_crossings"]["computed"] == 1
    assert found["fig10.OSM_peak"]["computed"] == pytest.approx(-8.91, abs=0.01)
    assert found["fig10.LDLSM_peak"]["computed"] == pytest.approx(-12.34, abs=0.01)
    assert "155.6 Hz; -21.63 dB from 1 to 30 Hz" in found["fig10.LDLSM_peak"]["remark"]
    assert found["fig10.LSM_above_OSM"]["computed"] == pytest.approx(7.88, abs=0.02)
    does_not = [key for key, finding in found.items() if finding["difference"] == "does not hold"]
    assert does_not == ["fig10.LSM_growth"]
    assert [found[f"fig10.{case}_encirclements"]["computed"] for case in ("OSM", "LSM", "LDLSM")] == [0, 4, 0]
    assert found["fig10.open_loop_poles"]["computed"] == 0


def test_findings_on_the_fmus(runs):
    """With steps of 1 ms, each of which is a delay of 2 deg at 5.57 Hz, and lines 0.2 Hz apart."""
    content = runs[1]
    found = {finding["key"]: finding for finding in content["findings"]}
    for name in ("first_crossing", "second_crossing", "phase_crossing"):
        finding = found[f"fig10.LSM_{name}"]
        assert finding["cosimulated"] == pytest.approx(finding["computed"], rel=3e-3)
    assert found["fig10.LSM_phase_margin"]["cosimulated"] == pytest.approx(-25.97 - 2.0, abs=0.5)
    for case in ("OSM", "LSM", "LDLSM"):
        finding = found[f"fig10.{case}_growth"]
        assert finding["cosimulated"] == pytest.approx(finding["computed"], rel=0.03)
    for case in CASES:
        loop = content["open_loop"][case]
        assert loop["lines"] == loop["lines_checked"] == 140
        assert loop["largest_deviation_db"] < 0.2 and loop["largest_deviation_deg"] < 2.0
    responses = content["responses"]
    assert [r["case"] for r in responses] == [*np.repeat(CASES, 2), "LSM"]
    for response in responses:
        assert response["pole_rad_s"] == pytest.approx(response["predicted_pole_rad_s"], rel=2e-3)
    assert [r["stable"] for r in responses] == [True] * 8 + [False]  # the last is beyond its limit
    assert responses[-1]["pole_rad_s"][0] > 0.4 and responses[-1]["last_second_over_first"] > 1.5


def test_cases(runs):
    cases = runs[1]["cases"]
    assert {name: case["unstable_poles"] for name, case in cases.items()} == dict.fromkeys(CASES, 0)
    assert cases["LSM"]["delay_limit_s"] == pytest.approx(0.0916, abs=1e-4)
    assert cases["LSM"]["delay_limit_by_bisection_s"] == pytest.approx(cases["LSM"]["delay_limit_s"], abs=2e-5)
    assert [cases[name]["delay_limit_s"] for name in ("OSM", "LDOSM", "LDLSM")] == [None] * 3
    assert [round(cases[name]["mobile_base_factor"], 3) for name in ("OSM", "LSM")] == [0.041, 2.042]
    assert [round(cases[name]["small_gain"], 3) for name in CASES] == [0.266, 2.332, 0.023, 0.195]
    assert all(case["small_gain"] <= case["small_gain_by_bound"] for case in cases.values())
    assert cases["LSM"]["largest_sensitivity"] == pytest.approx(2.01, abs=0.01)


def test_text_tables_and_figures(runs):
    folder = runs[0].output
    text = (folder / "stability.md").read_text()
    for said in (
        "does not survive",
        "stays below one for OSM, LDOSM, LDLSM",
        "certainly stable as far as the delay goes",
        "at the 560 of 560 lines with enough coherence",
        "it says nothing of LSM (2.33)",
        "With the delay of 0.02 s, stable: OSM, LSM, LDOSM, LDLSM; unstable: none.",
        "Beyond the limit of 91.6 ms, with 100 ms, the motion of LSM grows",
        "| suspension 1 | -0.453 +33.72i | -0.761 +33.41i | -18.689 +25.98i | -18.593 +24.83i |",
    ):
        assert said in text
    for name in ("bode", "nyquist", "sensitivity", "fine", "payload"):
        assert (folder / f"stability_{name}.png").stat().st_size > 20_000


def test_all_that_the_pole_table_leaves_out_is_counted():
    """Poles in the table are in the left half-plane; the argument principle counts all there are."""
    verdict = judge("LSM", published_numbers()["text.delay"].value)
    assert verdict.poles.real.max() < 0.0 and verdict.unstable_poles == 0


def test_larger_damping_is_that_of_section_4_2():
    damping = [leg.damping for leg in load_case("LDLSM").manipulator.fine_legs]
    assert damping == [published_numbers()["text.fine_damping_large"].value] * 3
    assert load_case("LDLSM").bus.mass == load_case("LSM").bus.mass < load_case("OSM").bus.mass
