"""The documents: links lead somewhere, commands exist, the drawing draws."""

import re
from pathlib import Path

import pytest
from support.browser import find_browser
from support.models import load_script

from ps_fmu.slavekit.pack.sources import _DATA

ROOT = Path(__file__).parents[1]
PLACES = "*.md", "fmus/**/*.md", "docs/**/*.md", "system/**/*.md"
DOCUMENTS = sorted(path for place in PLACES for path in ROOT.glob(place))


@pytest.mark.parametrize(
    ("pattern", "from_root"), [(r"\]\(([^)#\s]+)", False), (r"`((?:src|tests|system|docs)/[\w/.-]+)`", True)]
)
def test_files_that_links_lead_to_and_that_are_named_exist(pattern, from_root):
    assert len(DOCUMENTS) > 40
    missing = [
        (str(path), target) for path in DOCUMENTS for target in re.findall(pattern, path.read_text(encoding="utf-8"))
        if "://" not in target and not ((ROOT if from_root else path.parent) / target).exists()
    ]  # fmt: skip
    assert missing == []


def test_commands_of_the_readme_exist():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in set(re.findall(r"\bmake (\w+)", readme)):
        assert re.search(rf"^{target}:", makefile, re.MULTILINE), target
    assert (ROOT / ".ci" / "run").read_text(encoding="utf-8").splitlines()[-1] == "make test"
    assert "make test" in readme
    assert [name for name in re.findall(r"tests/[\w/]+\.py", makefile) if not (ROOT / name).exists()] == []


def test_make_watches_all_that_is_packed_into_fmus_and_cleans_no_results():
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8").replace("\\\n", "")
    (watched,) = re.findall(r"^FMU_SOURCES := (.*)", makefile, re.MULTILINE)
    assert "LICENSE" in watched.split()
    assert {f"'*{end}'" for end in (*_DATA, ".py", ".so")} <= set(watched.rstrip(")").split())
    (removed,) = re.findall(r"^clean:\n\trm -rf (.*)", makefile, re.MULTILINE)
    assert "build" in removed.split() and "results" not in removed


def test_pages_that_cannot_be_tested_fail_in_continuous_integration(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name: None)
    monkeypatch.delenv("CI", raising=False)
    assert find_browser() is None
    monkeypatch.setenv("CI", "true")
    with pytest.raises(RuntimeError, match="Chromium is not installed"):
        find_browser()
    assert "export CI=true\n" in (ROOT / ".ci" / "run").read_text(encoding="utf-8")


def script(name):
    """A script of docs/ as a module."""
    return load_script(ROOT / "docs" / f"{name}.py")


@pytest.mark.parametrize("suffix", [".svg", ".png"])
@pytest.mark.parametrize("name", ["loop", "step"])
def test_the_diagrams_are_drawn(tmp_path, name, suffix):
    script(f"draw_{name}").draw(tmp_path / f"{name}{suffix}")
    assert (tmp_path / f"{name}{suffix}").stat().st_size > 10_000


def test_the_study_of_the_schemes_is_drawn(tmp_path):
    """With two steps, which the table of docs/any-system.md has among others."""
    schemes = script("draw_schemes")
    steps = {name: own[:2] for name, own in schemes.STEPS.items()}
    found = schemes.measure(steps)
    schemes.draw(tmp_path / "schemes.png", found, steps)
    assert (tmp_path / "schemes.png").stat().st_size > 10_000
    text = (ROOT / "docs" / "any-system.md").read_text(encoding="utf-8")
    kept = re.findall(r"^\| ((?:jacobi|gauss-seidel|iterated), \w+) \| (.*) \|$", text, re.MULTILINE)
    for row, (name, cells) in zip(schemes.list_rows(found, steps), kept, strict=True):
        made, there = row.split(" | ")[1:], cells.split(" | ")
        assert row.startswith(f"| {name} |")
        assert [made[1], made[3].removesuffix(" |")] == [there[1], there[3]], "errors with the longest step"


def test_the_architecture_is_that_of_today(tmp_path):
    """The picture is drawn from the imports; each room has a row of the table."""
    drawing = script("draw_rooms")
    drawing.draw(tmp_path / "rooms.svg")
    assert (tmp_path / "rooms.svg").read_bytes() == (ROOT / "docs" / "rooms.svg").read_bytes(), (
        "python docs/draw_rooms.py draws it again"
    )
    text = (ROOT / "docs" / "developers" / "architecture.md").read_text(encoding="utf-8")
    assert [room for room in drawing.list_rooms()[1:] if f"`{room}`" not in text] == []
