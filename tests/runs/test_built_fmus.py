import os
import shutil
from pathlib import Path

import pytest

from ps_fmu.runs.built_fmus import ensure_built, find_newest_source, list_models, list_outdated

TOYS = Path(__file__).parents[1] / "slavekit" / "models"


@pytest.fixture
def checkout(tmp_path):
    """A checkout whose sources were changed at 1000 s, and FMUs that were built at 2000 s."""
    for path in ("fmus/disturbance_source", "fmus/pointing_commander"):
        source = tmp_path / path / f"{path.removeprefix('fmus/')}.py"
        source.parent.mkdir(parents=True)
        source.write_text("")
        os.utime(source, (1000, 1000))
    folder = tmp_path / "build"
    folder.mkdir()
    for name in ("PointingCommander", "DisturbanceSource"):
        (folder / f"{name}.fmu").write_text("")
        os.utime(folder / f"{name}.fmu", (2000, 2000))
    return tmp_path


def test_each_folder_makes_an_fmu(checkout):
    assert list_models(checkout) == ["DisturbanceSource", "PointingCommander"]


def test_what_is_newer_than_its_sources_is_kept(checkout):
    assert find_newest_source(checkout) == 1000.0
    assert list_outdated(checkout / "build", checkout) == []
    assert ensure_built(checkout / "build", checkout) == []


def test_missing_and_old_fmus_are_named(checkout):
    (checkout / "build" / "PointingCommander.fmu").unlink()
    os.utime(checkout / "build" / "DisturbanceSource.fmu", (500, 500))
    assert list_outdated(checkout / "build", checkout) == ["DisturbanceSource", "PointingCommander"]


def test_a_new_folder_is_a_new_fmu(tmp_path):
    """Nothing else names it: it is found, built, and then up to date."""
    shutil.copytree(TOYS / "waves", tmp_path / "fmus" / "waves")
    assert ensure_built(tmp_path / "build", tmp_path) == ["Waves"]
    assert (tmp_path / "build" / "Waves.fmu").is_file()
    assert ensure_built(tmp_path / "build", tmp_path) == []


def test_compiled_modules_are_no_sources(checkout):
    cache = checkout / "fmus" / "__pycache__"
    cache.mkdir(parents=True)
    (cache / "a.pyc").write_text("")
    assert find_newest_source(checkout) == 1000.0
