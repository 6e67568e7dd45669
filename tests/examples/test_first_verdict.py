"""The walk of a newcomer, from the payload's file on: what stands in its README, with a short run."""

import json
import re
import subprocess
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
FOLDER = ROOT / "examples" / "first_verdict"


def test_from_the_payload_to_the_verdict(built_fmus, tmp_path):
    command = [FOLDER / "walk.sh", "--ready", tmp_path, "16"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode in (0, 1), done.stderr[-2000:]
    summary = json.loads((tmp_path / "run" / "summary.json").read_text())
    verdicts = summary["verdicts"]
    assert len(verdicts) == 4
    assert {verdict["signal"] for verdict in verdicts} >= {"|plant.line_of_sight|", "plant.payload_rotation.x"}
    assert done.returncode == (0 if all(verdict["met"] for verdict in verdicts) else 1)
    assert (tmp_path / "run" / "report.html").stat().st_size > 100_000
    assert len(re.findall(r"^ +\d+ s  ", done.stdout, re.MULTILINE)) == 3
    payload = tomllib.loads((FOLDER / "my_payload.toml").read_text())
    assert f"payload {payload['payload']['mass']:g} kg, bus {payload['bus']['mass']:g} kg" in done.stdout


def test_a_run_that_fails_is_no_verdict(built_fmus, tmp_path):
    report = tmp_path / "run" / "report.html"  # of an earlier walk: it stays, and is not taken for that of this one
    report.parent.mkdir()
    report.write_text("earlier, by ps_fmu")
    done = subprocess.run([FOLDER / "walk.sh", "--ready", tmp_path, "3"], capture_output=True, text=True, timeout=300)
    assert done.returncode == 1
    assert "12 s are all of the run of 3 s" in done.stderr
    assert "There is no report: the run has failed." in done.stderr
    assert "Requirements:" not in done.stdout and report.read_text() == "earlier, by ps_fmu"


def test_the_readme_names_what_is_there():
    text = (FOLDER / "README.md").read_text()
    named = re.findall(r"\]\(([^)#]+)", text) + re.findall(r"examples/first_verdict/[\w.]+", text)
    assert len(named) > 5
    assert [name for name in named if not (FOLDER / name).exists() and not (ROOT / name).exists()] == []
