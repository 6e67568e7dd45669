"""The launcher in the package belongs to its source."""

import hashlib
import json
import zipfile

import pytest

from ps_fmu.fmu.launcher import compile as launcher

RECORD = json.loads((launcher.FOLDER / "launcher.json").read_text())


def test_the_record_describes_sources_and_libraries():
    libraries = {platform: launcher.library(platform).read_bytes() for platform in launcher.TARGETS}
    assert json.loads(launcher.record(libraries)) == RECORD, "sources have changed: make launcher"


@pytest.mark.parametrize("platform", launcher.TARGETS)
def test_compiling_gives_the_same_bytes(platform):
    content = launcher.compiled(platform)
    assert hashlib.sha256(content).hexdigest() == RECORD["libraries"][platform], "make launcher"


def test_another_compiler_is_refused(monkeypatch):
    monkeypatch.setattr(launcher, "COMPILER", "0.0.1")
    with pytest.raises(launcher.CompileError, match=r"pip install ziglang==0\.0\.1"):
        launcher.compiled("linux64")


def test_a_mistake_in_the_source_is_told(monkeypatch):
    monkeypatch.setattr(launcher, "FLAGS", (*launcher.FLAGS, "-Dthread=static"))
    with pytest.raises(launcher.CompileError, match="linux64: the compiler says:"):
        launcher.compiled("linux64")


def test_an_fmu_carries_pythonfmus_library_as_it_is(built):
    import pythonfmu

    stock = launcher.Path(pythonfmu.__file__).parent / "resources/binaries/linux64/libpythonfmu-export.so"
    with zipfile.ZipFile(built["waves"]) as archive:
        assert archive.read("binaries/linux64/libpythonfmu-export.so") == stock.read_bytes()
        assert archive.read("binaries/linux64/Waves.so") == launcher.library("linux64").read_bytes()
