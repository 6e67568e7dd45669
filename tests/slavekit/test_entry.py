"""The script that the native library starts, without the library."""

import importlib
import shutil
import sys

from ps_fmu.slavekit.author import guard
from ps_fmu.slavekit.pack.modules import write_entry


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
