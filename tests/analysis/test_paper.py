"""ps-fmu analyse paper."""

import json
import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ps_fmu.analysis import jitter, paper, stability, trajectories, transmissibility, workspace
from ps_fmu.analysis.command import Options
from ps_fmu.analysis.errata import Erratum
from ps_fmu.analysis.result import Finding
from ps_fmu.cli import main
from ps_fmu.manipulator.parameters import load
from ps_fmu.paper import published

ROOT = Path(__file__).parents[2]
SYSTEM = ROOT / "system" / "SystemStructure.ssd"


def test_every_number_of_the_paper_is_computed():
    """Only the keys matter here: one verdict stands for all cases of the stability, and stubs for the runs."""
    lighter = stability.judge("LSM", published()["text.delay"].value)
    jittery = SimpleNamespace(rms=np.ones(3), radius_rms=1.0)
    run = SimpleNamespace(
        rms_passive=np.ones(3), rms_active=np.ones(3), rejection=np.ones(3),
        passive=SimpleNamespace(scatter=jittery), active=SimpleNamespace(scatter=jittery),
    )  # fmt: skip
    results = SimpleNamespace(theory=(jittery, jittery), rejection=np.ones(3), measured=run)
    paths = [SimpleNamespace(solver=solver, error=np.zeros(1)) for solver in ("trilateration", "Algorithm 1")]
    orientations = ("nominal", "roll", "pitch", "yaw")
    found = {
        "workspace": workspace.findings(workspace.compute()),
        "trajectories": trajectories.findings(paths),
        "transmissibility": transmissibility.findings({"nominal": transmissibility.curves(load(), (0.0, 0.0, 0.0))}),
        "stability": stability.findings(dict.fromkeys(stability.CASES, lighter)),
        "jitter": jitter.findings(dict.fromkeys(orientations, results)),
    }
    assert found.keys() == set(paper.PARTS)
    parameters = paper.parameter_findings(Options(Path(), system=SYSTEM))
    findings = paper.in_order_of_the_paper([*parameters, *(f for part in found.values() for f in part)])
    assert [f.key for f in findings] == list(published())
    assert paper.not_computed(findings) == []


def test_parameters_are_those_of_the_paper():
    for finding in paper.parameter_findings(Options(Path(), system=SYSTEM)):
        assert finding.computed == finding.published.value, finding.key


def test_a_number_that_is_found_twice_is_refused():
    with pytest.raises(ValueError, match=r"table1\.roll_max: two analyses"):
        paper.in_order_of_the_paper([Finding("table1.roll_max", 9.6), Finding("table1.roll_max", 9.5)])


def test_a_number_without_a_value_is_neither_right_nor_wrong():
    assert Finding("text.rejection").difference == "not computed"


def test_what_is_written(tmp_path, capsys, monkeypatch):
    """With the errata of one entry, and without the other analyses: these have their own tests."""
    erratum = Erratum("(1)", "wrong", "right", "computed", 1e-12, 0.5)
    monkeypatch.setattr(paper, "PARTS", ())
    monkeypatch.setattr("ps_fmu.analysis.errata.ENTRIES", (lambda: erratum,))
    assert main(["analyse", "paper", "--output", str(tmp_path), "--system", str(SYSTEM)]) == 0
    content = json.loads((tmp_path / "paper.json").read_text())
    assert [finding["key"] for finding in content["findings"]] == list(published())
    assert "table1.roll_max" in content["not_computed"] and "text.OSM_mass" not in content["not_computed"]
    assert content["errata"][0]["error_printed"] == 0.5
    assert "| (1) | wrong | right | 1e-12 | 0.5 | computed |" in (tmp_path / "paper.md").read_text()
    said = len(content["findings"]) - len(content["not_computed"])
    assert f"{said} of them are computed here" in capsys.readouterr().out
    assert (tmp_path / "paper.html").is_file()


def test_a_missing_parameter_set_is_said_before_anything_is_computed(tmp_path, capsys):
    alone = tmp_path / "alone.ssd"
    alone.write_text("")
    assert main(["analyse", "paper", "--output", str(tmp_path), "--system", str(alone)]) == 1
    assert "large_damping.ssv" in capsys.readouterr().err


def test_the_result_that_the_readme_links_is_true():
    """docs/paper, made by `ps-fmu analyse paper`: what can be computed quickly is the same today."""
    folder = ROOT / "docs" / "paper"
    stored = {finding["key"]: finding for finding in json.loads((folder / "paper.json").read_text())["findings"]}
    assert list(stored) == list(published())
    lighter = stability.judge("LSM", published()["text.delay"].value)
    today = [
        *workspace.findings(workspace.compute()),
        *stability.findings(dict.fromkeys(stability.CASES, lighter))[:4],
        *transmissibility.findings({"nominal": transmissibility.curves(load(), (0.0, 0.0, 0.0))})[:1],
    ]
    for finding in today:
        assert stored[finding.key]["published"] == finding.published.value
        assert stored[finding.key]["computed"] == pytest.approx(finding.computed, rel=1e-6, abs=1e-4), finding.key
    text = (folder / "paper.md").read_text()
    pictures = re.findall(r"!\[[^]]*\]\(([^)]*)\)", text)
    assert sorted(pictures) == sorted(path.name for path in folder.glob("*.png"))
    assert "docs/paper/paper.md" in (ROOT / "README.md").read_text()
