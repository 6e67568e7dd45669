"""fmus/README.md on other tools: the table is what the tests run, and the recipes run."""

import os
import re
import subprocess
from pathlib import Path

import pytest
from support.importers import IMPORTERS, interpreter_with
from support.jobs import HOSTS

from ps_fmu.cosim import read_system, write_ssp

ROOT = Path(__file__).parents[2]
README = (ROOT / "fmus" / "README.md").read_text(encoding="utf-8")
ROWS = [
    [cell.strip() for cell in line.strip("| ").split("|")]
    for line in README.partition("### Where they were run")[2].partition("\n### ")[0].splitlines()
    if line.startswith("| ") and not line.startswith("| Tool")
]


def recipe(tool: str) -> str:
    """The Python code below the tool's heading."""
    section = README.partition(f"\n### {tool}\n")[2].partition("\n### ")[0]
    return section.partition("```python\n")[2].partition("```")[0]


def test_the_table_says_what_the_tests_run():
    """Each tool in the list is asked for by a test, or else the list would promise too much."""
    assert {row[0] for row in ROWS if row[2] == "tests"} == {*IMPORTERS, "C host"}
    assert {row[2] for row in ROWS} == {"tests", "by hand", "not run"}
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests" / "system").glob("test_*.py"))
    assert "interpreter_with(" in tests
    assert [name for name in IMPORTERS if f'"{name}"' not in tests] == []


def test_the_table_names_the_releases_that_are_installed_for_the_tests():
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8") + (ROOT / "Makefile").read_text(encoding="utf-8")
    for name, version, *_ in (row for row in ROWS if row[0] in IMPORTERS):
        package, release = version.split()
        assert package == IMPORTERS[name].package
        assert re.search(rf"\b{re.escape(package)}=={re.escape(release)}\s", pins), version


def test_each_tool_has_a_recipe():
    for row in ROWS:
        heading = row[0] if row[2] != "not run" else f"{row[0]} (not run)"
        assert row[0] == "C host" or f"\n### {heading}\n" in README, heading


@pytest.fixture(scope="module")
def folder(built_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the recipes expect around them."""
    folder = tmp_path_factory.mktemp("recipes")
    (folder / "build").mkdir()
    (folder / "build" / "fmus").symlink_to(built_fmus)
    (folder / "system").symlink_to(ROOT / "system")
    write_ssp(read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus), folder / "pointing.ssp")
    return folder


@pytest.mark.parametrize("tool", ["Our own master", *IMPORTERS])
def test_the_recipe_runs(tool, folder):
    interpreter = interpreter_with("FMPy" if tool == "Our own master" else tool)
    before = "from ecos_library import load_tbb\nload_tbb()\n" if tool == "Ecos" else ""
    command = [str(interpreter), "-c", before + recipe(tool)]
    environment = os.environ | {"PYTHONPATH": str(HOSTS)}
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    assert float(run.stdout.split()[-1]) != 0.0, run.stdout
