"""The modules of an FMU in an archive, and the script that the native library starts."""

import hashlib
import importlib
import importlib.util
import io
import shutil
import subprocess
import sys
import traceback
import zipfile
from pathlib import Path, PurePosixPath

import pytest
from support.archives import put, rewrite

from ps_fmu.slavekit.author import guard
from ps_fmu.slavekit.pack.modules import compile_module, pack_modules, write_entry

# --- The modules inside FMUs: an archive with byte code, the same in any process, used only where it fits ---------

SOURCE = b'''"""A module."""
KNOWN = {"b", "a", "c", "?"}


def find(name, table={"left": 1.5}):
    return name in {"left", "right", "both", "none"} and [part for part in (1, (2, "left")) if part]
'''
GUARD = b"def keep_alive(*objects): pass\ndef find_stand_in(): return object\n"


def make_package(folder, package, files):
    """A package as in an FMU in ``folder``, and the name of its archive."""
    files = {PurePosixPath(name): content for name, content in files.items()}
    files.setdefault(PurePosixPath("__init__.py"), b"")
    for name in ("slavekit", "slavekit/author"):
        files[PurePosixPath(name, "__init__.py")] = b""
    files[PurePosixPath("slavekit/author/guard.py")] = GUARD
    archive, packed = pack_modules(package, files)
    for name, content in packed.items():
        target = folder / package / name
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(content)
    return folder / package / archive


def start(folder, package, archive, module="toy", model="Toy"):
    """The class of an FMU in ``folder``, by way of its entry script."""
    name = f"entry_{hashlib.sha256(str(folder).encode()).hexdigest()[:8]}"
    (folder / f"{name}.py").write_bytes(write_entry(package, archive.name, module, model))
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    return getattr(importlib.import_module(name), model)


def test_byte_code_is_the_same_in_any_process():
    code = """
from hashlib import sha256
from pathlib import Path, PurePosixPath
from ps_fmu.slavekit.pack.modules import pack_modules
files = {PurePosixPath("kit", path.name): path.read_bytes() for path in Path(sys.argv[1]).glob("*.py")}
name, packed = pack_modules("package", files | {PurePosixPath("toy.py"): SOURCE})
print(name, *(f"{place} {sha256(packed[place]).hexdigest()}" for place in sorted(packed)))
"""
    kit = Path(guard.__file__).parent
    found = set()
    for seed, first in (
        ("1", ""),
        ("2", "import numpy, ast; sys.intern('?')"),
        ("random", "import re"),
    ):
        command = [sys.executable, "-c", f"import sys\n{first}\nSOURCE = {SOURCE!r}\n{code}", str(kit)]
        environment = {"PYTHONHASHSEED": seed, "PYTHONPATH": str(kit.parents[2])}
        found.add(subprocess.run(command, env=environment, check=True, capture_output=True, text=True).stdout)
    assert len(found) == 1


def test_a_module_comes_from_the_archive_without_being_compiled(tmp_path, monkeypatch):
    inner = b"import pkgutil\nDATA = pkgutil.get_data(__name__, 'numbers.txt')\ndef fail(): raise ValueError('here')\n"
    files = {
        "toy.py": b"from .inner.part import DATA, fail\nclass Toy: data, fail = DATA, staticmethod(fail)\n",
        "inner/__init__.py": b"",
        "inner/part.py": inner,
        "inner/numbers.txt": b"1 2 3",
    }
    archive = make_package(tmp_path, "toy_in_an_archive", files)
    compiled, real = [], compile

    def compile_and_note(source, name, *arguments, **more):
        compiled.append(Path(name).name.partition("_")[0])
        return real(source, name, *arguments, **more)

    with monkeypatch.context() as patch:
        patch.setattr("builtins.compile", compile_and_note)
        toy = start(tmp_path, "toy_in_an_archive", archive)
    assert compiled == ["entry"]
    assert toy.data == b"1 2 3"
    with pytest.raises(ValueError, match="here") as caught:
        toy.fail()
    report = "".join(traceback.format_exception(caught.value))
    assert 'toy_in_an_archive/inner/part.py", line 3, in fail\n    def fail(): raise ValueError' in report


def test_libraries_and_the_script_stay_files():
    files = {"__init__.py", "toy.py", "data/__init__.py", "data/a.csv", "native/__init__.py", "native/linux64/a.so"}
    archive, packed = pack_modules("toys", {PurePosixPath(name): b"" for name in files})
    tag = sys.implementation.cache_tag
    with zipfile.ZipFile(io.BytesIO(packed[PurePosixPath(archive)])) as inside:
        assert set(inside.namelist()) == {"data/__init__.py", "data/__init__.pyc", "data/a.csv"}
        assert {info.compress_type for info in inside.infolist()} == {zipfile.ZIP_STORED}
    loose = {"__init__.py", "toy.py", "native/__init__.py", "native/linux64/a.so"}
    cached = {
        f"{name}.{tag}.pyc" for name in ("__pycache__/__init__", "__pycache__/toy", "native/__pycache__/__init__")
    }
    assert {str(name) for name in packed} == loose | cached | {archive}


@pytest.mark.parametrize("change", ["source", "version"])
def test_byte_code_that_does_not_fit_is_left_alone(tmp_path, change):
    """Of another source, as in an FMU that somebody has edited, or for another Python."""
    package = f"toy_with_another_{change}"
    files = {"toy.py": b"from .inner.part import Toy\n", "inner/__init__.py": b""}
    archive = make_package(tmp_path, package, files | {"inner/part.py": b"class Toy: size = 1\n"})
    source = b"class Toy: size = 2\n"
    code = b"\0\0\r\n" + compile_module(source, "part.py")[4:16] + b"no byte code"
    changes = [put("inner/part.py", source), *([put("inner/part.pyc", code)] if change == "version" else [])]
    rewrite(archive, archive, *changes)
    assert start(tmp_path, package, archive).size == 2


def test_a_script_that_was_edited_counts(tmp_path):
    archive = make_package(tmp_path, "toy_edited", {"toy.py": b"class Toy: size = 1\n"})
    (tmp_path / "toy_edited" / "toy.py").write_bytes(b"class Toy: size = 2\n")
    assert start(tmp_path, "toy_edited", archive).size == 2


def test_modules_are_found_in_the_archive_of_the_next_fmu_when_the_first_is_gone(tmp_path):
    both = {"inner/__init__.py": b"", "inner/shared.py": b"LOADED = []\n"}
    folders = [tmp_path / name for name in ("first", "second", "third")]
    for folder, own in zip(folders, ("left", "right", "right"), strict=True):
        part = f"from . import shared\nshared.LOADED.append({own!r})\n".encode()
        toy = f"from .inner import shared, {own}\nclass Toy: loaded = shared.LOADED\n".encode()
        archive = make_package(folder, "toy_of_many", both | {f"{own}_toy.py": toy, f"inner/{own}.py": part})
        assert own in start(folder, "toy_of_many", archive, f"{own}_toy").loaded
        shutil.rmtree(folder)
    inner = sys.modules["toy_of_many.inner"]
    assert inner.shared.LOADED == ["left", "right"]
    places = [place for place in inner.__path__ if not place.startswith(str(folders[2]))]
    assert places == []


def test_the_script_adds_no_folder_that_it_is_not_in(tmp_path):
    """The library executes it twice; the first time takes its folder out of sys.path."""
    script = b"from .slavekit.author import guard\nclass Toy: pass\n"
    archive = make_package(tmp_path, "toy_run_twice", {"toy.py": script})
    start(tmp_path, "toy_run_twice", archive)
    (place,) = tmp_path.glob("entry_*.py")
    entry, inner = sys.modules[place.stem], sys.modules["toy_run_twice.slavekit"]
    home = tmp_path / "toy_run_twice"
    expected = {str(home / "slavekit"), str(archive / "slavekit")}
    assert set(inner.__path__) <= expected
    exec(compile(place.read_bytes(), place, "exec"), vars(entry), {})
    assert set(inner.__path__) <= expected


def test_another_fmu_in_a_folder_of_the_same_name(tmp_path):
    """Python keeps the list of an archive's files by its path."""
    for own in ("left", "right"):
        folder = tmp_path / "folder"
        files = {f"{own}_toy.py": f"from .inner.{own} import Toy\n".encode(), "inner/__init__.py": b""}
        files[f"inner/{own}.py"] = f"class Toy: name = {own!r}\n".encode()
        archive = make_package(folder, "toy_of_a_folder", files)
        entry = f"entry_of_{own}"
        (folder / f"{entry}.py").write_bytes(write_entry("toy_of_a_folder", archive.name, f"{own}_toy", "Toy"))
        sys.path.insert(0, str(folder))
        importlib.invalidate_caches()
        assert importlib.import_module(entry).Toy.name == own
        shutil.rmtree(folder)


# --- The script that the native library starts, without the library -----------------------------------------------

def test_the_library_is_shown_a_class_with_one_base(tmp_path, monkeypatch):
    """It executes the script with locals of their own, takes the name of a class from there and the class from the
    module."""
    package = tmp_path / "toy_of_the_search"
    package.mkdir()
    (package / "toy.py").write_text("class Toy: pass\n")
    (package / "slavekit" / "author").mkdir(parents=True)
    shutil.copy(guard.__file__, package / "slavekit" / "author" / "guard.py")
    script = tmp_path / "entry_of_the_search.py"
    script.write_bytes(write_entry("toy_of_the_search", "modules.zip", "toy", "Toy"))
    monkeypatch.syspath_prepend(str(tmp_path))
    module = importlib.import_module("entry_of_the_search")
    found = {}
    exec(compile(script.read_text(), script, "exec"), vars(module), found)
    (shown,) = (name for name, value in found.items() if isinstance(value, type))
    assert [repr(base) for base in found[shown].__mro__] == ["", "<class 'a.Fmi2Slave'>"]
    assert getattr(module, shown).__module__ == "toy_of_the_search.toy"


def test_an_import_in_another_thread_misses_no_entry(tmp_path, monkeypatch):
    package = tmp_path / "toy_of_the_entry"
    (package / "slavekit" / "author").mkdir(parents=True)
    (package / "slavekit" / "author" / "guard.py").write_text("def keep_alive(*objects): pass\n")
    (package / "toy.py").write_text("class Toy: pass\n")
    (tmp_path / "entry_of_the_toy.py").write_bytes(write_entry("toy_of_the_entry", "modules.zip", "toy", "Toy"))
    before = list(sys.path)
    monkeypatch.setattr(sys, "path", list(before))

    other = iter(sys.path)  # as the import system does for each module
    seen = [next(other)]
    sys.path.insert(0, str(tmp_path))  # as the library does
    seen.append(next(other))
    assert importlib.import_module("entry_of_the_toy").Toy.__module__ == "toy_of_the_entry.toy"
    seen.extend(other)
    assert sys.path == before  # the library's entry is gone
    assert set(seen) == set(before)
