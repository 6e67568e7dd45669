"""ps-fmu analyse workspace."""

import json

import pytest

from ps_fmu.cli import main
from ps_fmu.paper.figures.fig06 import round_down


def test_findings_text_and_figures(tmp_path, capsys):
    assert main(["analyse", "workspace", "--output", str(tmp_path)]) == 0
    content = json.loads((tmp_path / "workspace.json").read_text())
    for finding in content["findings"][:6]:
        assert abs(finding["computed"] / finding["published"] - 1.0) < 1e-5
    assert content["cone_deg"] == pytest.approx(7.434293, abs=1e-6)
    assert content["cone_with_free_twist_deg"] == pytest.approx(8.759126, abs=1e-6)
    printed = " ".join(capsys.readouterr().out.split())
    assert "Pitch alone goes from -7.88 to 7.44 deg" in printed and "+-4.04 deg" in printed
    assert "tilted by 7.43 deg in any direction without twist, and by 8.75 deg if" in printed  # rounded down
    for name in ("workspace.png", "workspace_cone.png"):
        assert (tmp_path / name).stat().st_size > 20_000
        assert name in (tmp_path / "workspace.md").read_text()


def test_an_output_that_cannot_be_written_is_said(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["analyse", "workspace", "--output", str(tmp_path / "file")]) == 2
    assert "ps-fmu analyse workspace: --output: cannot write" in capsys.readouterr().err


def test_what_is_said_to_be_within_reach_is_rounded_down():
    assert [round_down(angle) for angle in (7.4377, 7.43, 8.0)] == ["7.43", "7.43", "8.00"]
