"""The documents: links lead somewhere, commands exist, the drawing draws."""

import re
from itertools import combinations
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fmpy import read_model_description
from support.browser import INSTALL, Browser, find_browser
from support.models import load_script

from ps_fmu.cli import main
from ps_fmu.slavekit.pack.sources import _DATA
from ps_fmu.studies import study

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


PICTURES = script("draw_pictures").PICTURES


@pytest.mark.parametrize("name", PICTURES)
def test_pictures_are_those_of_the_program_of_today(name):
    """Drawn from parameters, .ssd files, imports and a run; with a title and a description for screen readers."""
    drawn = PICTURES[name]().render()
    assert drawn == (ROOT / "docs" / f"{name}.svg").read_text(encoding="utf-8"), (
        f"python docs/draw_pictures.py {name} draws it again"
    )
    root = ElementTree.fromstring(drawn)
    assert all(len(root.findtext(f"{{*}}{kind}")) > 10 for kind in ("title", "desc"))
    for command in re.findall(r">ps-fmu (\w+)", drawn):
        assert main([command, "--help"]) == 0


@pytest.mark.skipif(find_browser() is None, reason=f"Chromium is not installed: {INSTALL}")
def test_texts_of_pictures_lie_within_them_apart_and_follow_the_colours_of_the_reader():
    with Browser() as browser:
        for name in PICTURES:
            browser.open(ROOT / "docs" / f"{name}.svg")
            size, texts = browser.evaluate(
                "[document.documentElement.viewBox.baseVal, [...document.querySelectorAll('text')]]"
                ".map(found => 'x' in found ? [found.width, found.height] : found.map(text => {"
                " const b = text.getBBox(); return [b.x, b.y, b.x + b.width, b.y + b.height, text.textContent]; }))"
            )
            assert [text for x, y, *end, text in texts if min(x, y) < 0 or end[0] > size[0] or end[1] > size[1]] == []
            across = [
                (name, one[4], other[4]) for one, other in combinations(texts, 2)
                if min(one[2], other[2]) > max(one[0], other[0]) + 1.0  # px
                and min(one[3], other[3]) > max(one[1], other[1]) + 3.0  # px: lines of a text touch
            ]  # fmt: skip
            assert across == []
        paper = []
        for scheme in ("light", "dark"):
            browser.prefer(scheme)
            paper.append(browser.evaluate("getComputedStyle(document.querySelector('.f-paper')).fill"))
        assert paper == ["rgb(255, 255, 255)", "rgb(20, 24, 30)"]


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


def test_the_architecture_names_each_package():
    text = (ROOT / "docs" / "developers" / "architecture.md").read_text(encoding="utf-8")
    packages = [path.parent.name for path in (ROOT / "src" / "ps_fmu").glob("*/__init__.py")]
    assert len(packages) > 15
    assert [name for name in packages if f"`{name}`" not in text] == []


def test_the_tables_of_systems_and_signals_are_those_of_the_files(built_fmus):
    """docs/words.md: components and high-pass frequency of each .ssd file; signals are outputs of the plant."""
    text = (ROOT / "docs" / "words.md").read_text(encoding="utf-8")
    isolator, plant = (read_model_description(built_fmus / f"{name}.fmu").modelVariables
                       for name in ("FeedforwardIsolator", "ManipulatorPlant"))  # fmt: skip
    (default,) = [one.start for one in isolator if one.name == "filters.highpass_frequency"]
    listed = re.findall(r"^\| `(\w+\.ssd)` \| (\S+) \| (\S+) \| (\S+) \| (\S+) Hz \|", text, re.MULTILINE)
    assert sorted(name for name, *_ in listed) == sorted(path.name for path in (ROOT / "system").glob("*.ssd"))
    for name, *marks, frequency in listed:
        system = (ROOT / "system" / name).read_text(encoding="utf-8")
        there = [f'<ssd:Component name="{component}"' in system for component in ("sensors", "coils", "pointing")]
        assert [mark == "yes" for mark in marks] == there, name
        (stated,) = re.findall(r'highpass_frequency"><ssv:Real value="(\S+)"', system) or [default]
        assert float(frequency) == float(stated), name
    outputs = {re.split(r"\.|_\d$", one.name)[0] for one in plant if one.causality == "output"}
    signals = re.findall(r"^\| `(\w+)` \| .* (?:yes|no|relative|only this) \|", text, re.MULTILINE)
    assert len(signals) == 9 and set(signals) <= outputs


def test_the_tutorial_of_ones_own_instrument_is_short():
    """Lines of the files and commands that are typed, from nothing to verdict, budget, study and own controller."""
    text = (ROOT / "docs" / "tutorials" / "plot_2_my_instrument.py").read_text(encoding="utf-8")
    files = re.findall(r'write\(\s*"[\w.]+",\s*"""\n(.*?)"""', text, re.DOTALL)
    commands = re.findall(r"^run\(", text, re.MULTILINE)
    assert len(files) == 4 and 50 < sum(file.count("\n") for file in files) + len(commands) < 60


@pytest.mark.parametrize(
    ("title", "table"),
    [
        ("study", study._Study), ("from", study.Branch), ("vary", study.Vary), ("correlate", study.Correlation),
        ("observe", study.Observed), ("signals", study.Signals),
    ],
)  # fmt: skip
def test_the_reference_has_the_keys_of_a_study(title, table):
    text = (ROOT / "docs" / "reference.md").read_text(encoding="utf-8")
    start = re.search(rf"^\*\*`\[+{title}\]+`\*\*", text, re.MULTILINE).end()
    part = text[start : re.search(r"^\*\*|^## ", text[start:], re.MULTILINE).start() + start]
    assert [key for key in table.__struct_fields__ if not re.search(rf"`{key}\b", part)] == []
