"""ps-fmu analyse workspace."""

import json

from ps_fmu.cli import main


def test_findings_text_and_figures(tmp_path, capsys):
    assert main(["analyse", "workspace", "--output", str(tmp_path)]) == 0
    content = json.loads((tmp_path / "workspace.json").read_text())
    for finding in content["findings"][:6]:
        assert abs(finding["computed"] / finding["published"] - 1.0) < 1e-5
    assert content["cone_deg"] < 8.5 < content["cone_with_free_twist_deg"]
    printed = capsys.readouterr().out
    assert "Pitch alone goes from -7.88 to 7.44 deg" in printed and "+-4.04 deg" in printed
    for name in ("workspace.png", "workspace_cone.png"):
        assert (tmp_path / name).stat().st_size > 20_000
        assert name in (tmp_path / "workspace.md").read_text()


def test_an_output_that_cannot_be_written_is_said(tmp_path, capsys):
    (tmp_path / "file").write_text("")
    assert main(["analyse", "workspace", "--output", str(tmp_path / "file")]) == 2
    assert "ps-fmu analyse workspace: --output: cannot write" in capsys.readouterr().err
