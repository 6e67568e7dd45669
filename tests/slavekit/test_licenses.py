"""The licences in an FMU: an index first, and the text of everything that it contains."""

from pathlib import Path, PurePosixPath

import numpy as np
import pytest

from ps_fmu.slavekit.pack import licenses
from ps_fmu.slavekit.pack.licenses import License

PROJECT = Path(__file__).parents[2]


def test_the_index_lists_the_others_and_ends_with_the_own_licence():
    files = licenses.write_licenses(
        [License("a.txt", "package a", b"text a"), License("b/c.txt", "package b", b"text b")]
    )
    folder = PurePosixPath("documentation/licenses")
    assert files[folder / "a.txt"] == b"text a"
    assert files[folder / "b/c.txt"] == b"text b"
    index = files[folder / "license.txt"].decode()
    assert "a.txt: package a\nb/c.txt: package b\n" in index
    assert index.endswith((PROJECT / "LICENSE").read_text())


def test_sources_bring_the_licence_of_pythonfmu_and_of_data():
    sources = {PurePosixPath("p/x.csv"): b"1", PurePosixPath("p/x.license"): b"by X", PurePosixPath("p/y.py"): b""}
    found = {one.name: one for one in licenses.collect_source_licenses(sources)}
    assert set(found) == {"pythonfmu.txt", "x.txt"}
    assert b"NTNU" in found["pythonfmu.txt"].text
    assert found["x.txt"].text == b"by X"


def test_a_runtime_brings_those_of_python_packages_and_libraries(tmp_path):
    library = tmp_path / "libunknown.so.1"
    found = {one.name: one for one in licenses.collect_runtime_licenses(["numpy"], [library])}
    assert b"PYTHON SOFTWARE FOUNDATION LICENSE" in found["python.txt"].text
    assert b"OpenBLAS" in found["numpy/LICENSE.txt"].text
    assert found["numpy/LICENSE.txt"].subject == f"numpy {np.__version__} and the libraries that it brings"
    assert b"No licence text was found" in found["libunknown.so.1.txt"].text


def test_a_distribution_without_a_licence_is_named(monkeypatch):
    class Bare:
        version = "0"

        @staticmethod
        def read_text(_name):
            return None

    monkeypatch.setattr(licenses.importlib.metadata, "distribution", lambda _name: Bare())
    with pytest.raises(licenses.BuildError, match="the installed pythonfmu carries no licence text"):
        list(licenses.collect_source_licenses({}))
