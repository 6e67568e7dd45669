"""ps-fmu analyse stability."""

import json

import pytest

from ps_fmu.analysis.stability import parameters_of
from ps_fmu.cli import main
from ps_fmu.paper import published


def test_findings_verdicts_and_figures(tmp_path, capsys):
    assert main(["analyse", "stability", "--output", str(tmp_path)]) == 0
    content = json.loads((tmp_path / "stability.json").read_text())
    found = {finding["key"]: finding for finding in content["findings"]}
    assert found["fig10.LSM_phase_margin"]["computed"] == pytest.approx(-25.97, abs=0.01)
    assert found["fig10.OSM_peak"]["difference"] == found["fig10.LDLSM_peak"]["difference"] == "holds"
    cases = content["cases"]
    assert {name: case["unstable_poles"] for name, case in cases.items()} == dict.fromkeys(cases, 0)
    assert cases["LSM"]["unstable_poles_about_minus_one"] > 0
    assert cases["LSM"]["delay_limit_s"] == pytest.approx(0.0916, abs=1e-4)
    assert cases["LSM"]["delay_limit_by_bisection_s"] == pytest.approx(cases["LSM"]["delay_limit_s"], abs=2e-5)
    assert [cases[name]["delay_limit_s"] for name in ("OSM", "LDOSM", "LDLSM")] == [None] * 3
    assert [round(cases[name]["mobile_base_factor"], 3) for name in ("OSM", "LSM")] == [0.041, 2.042]
    assert "does not survive" in " ".join(capsys.readouterr().out.split())
    for name in ("bode", "nyquist", "sensitivity"):
        assert (tmp_path / f"stability_{name}.png").stat().st_size > 20_000


def test_larger_damping_is_that_of_section_4_3():
    damping = [leg.damping for leg in parameters_of("LDLSM").manipulator.fine_legs]
    assert damping == [published()["text.fine_damping_large"].value] * 3
    assert parameters_of("LDLSM").bus.mass == parameters_of("LSM").bus.mass < parameters_of("OSM").bus.mass
