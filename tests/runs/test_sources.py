import os

import pytest

from ps_fmu.runs.sources import FMU_NAMES, ensure_built, newest_source, out_of_date


@pytest.fixture
def checkout(tmp_path):
    """A checkout whose only source was changed at 1000 s, and FMUs that were built at 2000 s."""
    source = tmp_path / "src" / "ps_fmu" / "mechanism" / "paper.toml"
    source.parent.mkdir(parents=True)
    source.write_text("")
    os.utime(source, (1000, 1000))
    folder = tmp_path / "build"
    folder.mkdir()
    for name in FMU_NAMES:
        (folder / f"{name}.fmu").write_text("")
        os.utime(folder / f"{name}.fmu", (2000, 2000))
    return tmp_path


def test_what_is_newer_than_its_sources_is_kept(checkout):
    assert newest_source(checkout) == 1000.0
    assert out_of_date(checkout / "build", checkout) == []
    assert ensure_built(checkout / "build", checkout) == []


def test_missing_and_old_fmus_are_named(checkout):
    (checkout / "build" / "PointingCommander.fmu").unlink()
    os.utime(checkout / "build" / "DisturbanceSource.fmu", (500, 500))
    assert out_of_date(checkout / "build", checkout) == ["PointingCommander", "DisturbanceSource"]


def test_compiled_modules_are_no_sources(checkout):
    cache = checkout / "fmus" / "__pycache__"
    cache.mkdir(parents=True)
    (cache / "a.pyc").write_text("")
    assert newest_source(checkout) == 1000.0
