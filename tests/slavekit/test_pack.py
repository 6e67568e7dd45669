"""What goes into an FMU: sources, files, libraries, licences, launchers."""

import os
import shutil
import subprocess
import sys
import sysconfig
import zipfile
from pathlib import Path, PurePosixPath

import numpy as np
import pytest
import pythonfmu

from ps_fmu.files.plain import write_atomically
from ps_fmu.native import list_platforms, read_compiled
from ps_fmu.native.build import find_fmi_headers
from ps_fmu.slavekit.pack import licenses
from ps_fmu.slavekit.pack.bundle import cut_unloaded
from ps_fmu.slavekit.pack.licenses import License
from ps_fmu.slavekit.pack.sources import BuildError, collect_modules, rename_imports

# --- Which files an FMU carries, and the other names in them ------------------------------------------------------

NAMES = {"ps_fmu": "ps_fmu_12", "pythonfmu": "ps_fmu_12.pythonfmu"}


@pytest.fixture
def packages(tmp_path: Path) -> dict[str, Path]:
    files = {
        "script.py": "from pkg.a import thing\nimport json\n",
        "pkg/__init__.py": "",
        "pkg/a.py": "from . import b\nfrom .sub.c import x\n",
        "pkg/b.py": "def late():\n    from .late import y\n    return y\n",
        "pkg/late.py": "from other import z\n",
        "pkg/unused.py": "",
        "pkg/data.toml": "a = 1\n",
        "pkg/sub/__init__.py": "from .. import d\n",
        "pkg/sub/c.py": "x = 1\n",
        "pkg/sub/table.csv": "1\n",
        "pkg/sub/README.md": "text\n",
        "pkg/d.py": "",
        "other/__init__.py": "from .heavy import *\n",
        "other/heavy.py": "",
        "other/z.py": "",
    }
    for name, text in files.items():
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return {"pkg": tmp_path / "pkg", "other": tmp_path / "other"}


def test_only_what_is_imported_is_carried(packages):
    files = collect_modules(packages["pkg"].parent / "script.py", packages, hollow=("other",))
    assert sorted(map(str, files)) == [
        "other/__init__.py",
        "other/z.py",
        "pkg/__init__.py",
        "pkg/a.py",
        "pkg/b.py",
        "pkg/d.py",
        "pkg/data.toml",
        "pkg/late.py",
        "pkg/sub/__init__.py",
        "pkg/sub/c.py",
        "pkg/sub/table.csv",
    ]
    assert files[PurePosixPath("other/__init__.py")] == b""
    assert files[PurePosixPath("pkg/data.toml")] == b"a = 1\n"


def test_a_package_that_lists_its_modules_is_carried_whole(packages):
    (packages["pkg"] / "sub" / "__init__.py").write_text("import pkgutil\nKINDS = pkgutil.iter_modules(__path__)\n")
    (packages["pkg"] / "sub" / "kind.py").write_text("from .. import unused\n")
    files = collect_modules(packages["pkg"].parent / "script.py", packages)
    assert PurePosixPath("pkg/sub/kind.py") in files
    assert PurePosixPath("pkg/unused.py") in files


@pytest.mark.parametrize(
    ("source", "expected"),
    [
        ("from ps_fmu.slavekit.author.slave import Slave\n", "from ps_fmu_12.slavekit.author.slave import Slave\n"),
        ("from ps_fmu import fmu, manipulator as m\n", "from ps_fmu_12 import fmu, manipulator as m\n"),
        ("from pythonfmu.enums import E\n", "from ps_fmu_12.pythonfmu.enums import E\n"),
        ("from ps_fmu.a import (\n    ps_fmu,\n    b,\n)\n", "from ps_fmu_12.a import (\n    ps_fmu,\n    b,\n)\n"),
        ("from \\\n    ps_fmu.a import b\n", "from \\\n    ps_fmu_12.a import b\n"),
        ("é = 1; from ps_fmu.a import b\n", "é = 1; from ps_fmu_12.a import b\n"),
        ("def f():\n    from ps_fmu import a; from ps_fmu import b\n", None),
        ("from ps_fmu_tools import a\nfrom .ps_fmu import b\n", "from ps_fmu_tools import a\nfrom .ps_fmu import b\n"),
        (
            "'''ps_fmu is a package'''\nx = 'of ps_fmu'  # ps_fmu\n",
            "'''ps_fmu is a package'''\nx = 'of ps_fmu'  # ps_fmu\n",
        ),
    ],
)
def test_imports_are_renamed_and_nothing_else(source, expected):
    if expected is None:
        expected = source.replace("from ps_fmu ", "from ps_fmu_12 ")
    assert rename_imports(source.encode(), "x.py", NAMES).decode() == expected


@pytest.mark.parametrize(
    ("source", "problem"),
    [
        ("\nimport ps_fmu.slavekit\n", "x.py:2: 'import ps_fmu.slavekit'"),
        ("import pythonfmu as p\n", "x.py:1: 'import pythonfmu'"),
        ("import_module('ps_fmu.slavekit.author.slave')\n", "x.py:1: 'ps_fmu.slavekit.author.slave' looks like"),
        ("__import__('pythonfmu')\n", "x.py:1: 'pythonfmu' looks like"),
    ],
)
def test_what_cannot_be_renamed_is_told(source, problem):
    with pytest.raises(BuildError) as error:
        rename_imports(source.encode(), "x.py", NAMES)
    assert problem in str(error.value)


# ---  --------------------------------------------------------------------------------------------------------------

def test_text_and_bytes_are_written(tmp_path):
    write_atomically(tmp_path / "a.txt", "\N{MICRO SIGN}rad\n")
    write_atomically(tmp_path / "b.bin", b"\x00\xff")
    assert (tmp_path / "a.txt").read_bytes() == b"\xc2\xb5rad\n"
    assert (tmp_path / "b.bin").read_bytes() == b"\x00\xff"
    assert sorted(os.listdir(tmp_path)) == ["a.txt", "b.bin"]


def test_the_mode_is_that_of_an_ordinary_file(tmp_path):
    (tmp_path / "plain").write_text("")
    write_atomically(tmp_path / "atomic", "")
    assert (tmp_path / "atomic").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_what_is_no_ordinary_file_is_not_replaced(tmp_path):
    """Root could replace /dev/null."""
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path / "pipe", tmp_path):
        with pytest.raises(OSError, match="no ordinary file"):
            write_atomically(path, "new")
    assert (tmp_path / "pipe").is_fifo()
    assert os.listdir(tmp_path) == ["pipe"]


def test_a_failed_write_leaves_the_old_file_and_nothing_else(tmp_path, monkeypatch):
    target = tmp_path / "a.txt"
    target.write_text("old")

    def full_disk(*arguments):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "replace", full_disk)
    with pytest.raises(OSError, match=r"No space left on device: .*a\.txt"):
        write_atomically(target, "new")
    assert target.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


# --- Libraries without what is not loaded -------------------------------------------------------------------------

ANSWER = "int answer(void) { static int calls; return 41 + ++calls; }\n"
ASK = "import ctypes, sys; print(ctypes.CDLL(sys.argv[1]).answer())"


@pytest.fixture
def library(tmp_path) -> Path:
    """With debug information."""
    (tmp_path / "answer.c").write_text(ANSWER)
    compiler = ["cc"] if shutil.which("cc") else [sys.executable, "-m", "ziglang", "cc"]
    path = tmp_path / "answer.so"
    subprocess.run([*compiler, "-g", "-shared", "-fPIC", str(tmp_path / "answer.c"), "-o", str(path)], check=True)
    return path


def test_it_is_smaller_and_works(library):
    before = library.read_bytes()
    after = cut_unloaded(before)
    assert b".debug_info" in before
    assert b".debug_info" not in after
    assert len(after) < len(before)
    library.write_bytes(after)
    run = subprocess.run([sys.executable, "-c", ASK, str(library)], capture_output=True, text=True, check=True)
    assert run.stdout == "42\n"
    assert cut_unloaded(after) == after


def test_the_standard_librarys_modules_still_import(tmp_path):
    folder = Path(sysconfig.get_path("stdlib"), "lib-dynload")
    names = {"math": "pi", "_json": "scanstring", "_struct": "Struct", "zlib": "crc32"}
    for path in (path for path in folder.glob("*.so") if path.name.partition(".")[0] in names):
        (tmp_path / path.name).write_bytes(cut_unloaded(path.read_bytes()))
    copied = {path.name.partition(".")[0] for path in tmp_path.iterdir()}
    assert copied  # some interpreters have one or the other built in
    program = "import sys; sys.path.insert(0, sys.argv[1])\n"
    program += "".join(f"import {name}; assert {name}.__file__.startswith(sys.argv[1])\n" for name in copied)
    subprocess.run([sys.executable, "-I", "-c", program, str(tmp_path)], check=True)


def test_what_is_no_complete_library_stays_as_it_is(library):
    content = library.read_bytes()
    header = (find_fmi_headers() / "fmi2Functions.h").read_bytes()
    cases = [b"", b"\x7fELF", content[:63], content[:100], content[:2000], b"\x7fELF\x01" + content[5:], header]
    assert [cut_unloaded(case) for case in cases] == cases


# --- The licences in an FMU: an index first, and the text of everything that it contains --------------------------

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


# --- The launchers in an FMU are those in the package, and pythonfmu's libraries are as pythonfmu ships them ------

STOCK = Path(pythonfmu.__file__).parent / "resources" / "binaries"


@pytest.mark.parametrize(
    ("platform", "launcher", "library"),
    [("linux64", "Waves.so", "libpythonfmu-export.so"), ("win64", "Waves.dll", "pythonfmu-export.dll")],
)
def test_an_fmu_carries_both(built, platform, launcher, library):
    with zipfile.ZipFile(built["waves"]) as archive:
        assert archive.read(f"binaries/{platform}/{library}") == (STOCK / platform / library).read_bytes()
        assert archive.read(f"binaries/{platform}/{launcher}") == read_compiled("launcher", platform)[1]


def test_a_launcher_is_of_no_use_where_pythonfmu_has_no_library(built):
    with zipfile.ZipFile(built["waves"]) as archive:
        platforms = {name.split("/")[1] for name in archive.namelist() if name.startswith("binaries/")}
    assert platforms == {path.name for path in STOCK.iterdir()} < set(list_platforms("launcher"))
