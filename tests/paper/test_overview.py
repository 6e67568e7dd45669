"""ps-fmu analyse paper."""

import json
from pathlib import Path

import pytest

from ps_fmu.cli import main
from ps_fmu.paper import overview
from ps_fmu.paper.errata import Erratum
from ps_fmu.paper.published import make_finding, published_numbers

ROOT = Path(__file__).parents[2]
SYSTEM = ROOT / "system" / "SystemStructure.ssd"


def test_every_number_of_the_paper_is_computed(closed_form):
    assert list(closed_form) == list(published_numbers())
    assert overview.find_missing(closed_form.values()) == []


def test_settings_are_those_of_the_paper(closed_form):
    settings = [finding for finding in closed_form.values() if finding.setting]
    assert len(settings) == 17
    for finding in settings:
        assert finding.computed == finding.published.value, finding.key


def test_a_number_that_is_found_twice_is_refused():
    with pytest.raises(ValueError, match=r"table1\.roll_max: two analyses find this number"):
        overview.order_findings([make_finding("table1.roll_max", 9.6), make_finding("table1.roll_max", 9.5)])


def test_a_number_without_a_value_is_neither_right_nor_wrong():
    assert make_finding("text.rejection").difference == "not computed"


def test_what_is_written(tmp_path, capsys, monkeypatch):
    """With the errata of one entry, and with one analysis: the others have their own tests."""
    erratum = Erratum("(1)", "wrong", "right", "computed", 1e-12, 0.5)
    monkeypatch.setattr(overview, "FIGURES", ("workspace",))
    monkeypatch.setattr("ps_fmu.paper.errata.ENTRIES", (lambda: erratum,))
    assert main(["analyse", "paper", "--output", str(tmp_path), "--system", str(SYSTEM)]) == 0
    content = json.loads((tmp_path / "paper.json").read_text())
    assert [finding["key"] for finding in content["findings"]] == list(published_numbers())
    computed = {"table1.roll_max", "text.OSM_mass"}
    assert "fig8.start" in content["not_computed"] and not computed.intersection(content["not_computed"])
    assert (tmp_path / "workspace.json").is_file() and (tmp_path / "workspace_cone.png").is_file()
    assert content["errata"][0]["error_printed"] == 0.5
    assert "| (1) | wrong | right | 1e-12 | 0.5 | computed |" in (tmp_path / "paper.md").read_text()
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines())) <= 120
    assert f"The table has {len(published_numbers())} numbers of the paper" in " ".join(printed.split())
    assert (tmp_path / "paper.html").is_file()


def test_a_missing_parameter_set_is_said_before_anything_is_computed(tmp_path, capsys):
    alone = tmp_path / "alone.ssd"
    alone.write_text("")
    assert main(["analyse", "paper", "--output", str(tmp_path), "--system", str(alone)]) == 1
    assert "large_damping.ssv" in capsys.readouterr().err
