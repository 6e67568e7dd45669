"""Temporary folders, and the one that an FMU is unpacked into in a process."""

import gc
import os
import shutil
import subprocess
import sys
import tempfile
import textwrap
import zipfile
from concurrent.futures import ThreadPoolExecutor

import pytest
from fmpy import platform

from ps_fmu.cosim import SystemFileError, unpacked
from ps_fmu.cosim.unpacked import (
    LOCK,
    discard_unpacked,
    make_temporary,
    provide_unpacked,
    release_unpacked,
    remove_temporary,
)
from ps_fmu.native import find_platform


@pytest.fixture
def archive(tmp_path):
    def write(name="a.zip", content="1"):
        path = tmp_path / name
        with zipfile.ZipFile(path, "w") as file:
            file.writestr("resources/data.txt", content)
        return path

    return write


def test_the_same_content_has_one_folder(archive):
    first, again, copy = (provide_unpacked(archive(name)) for name in ("a.zip", "a.zip", "b.zip"))
    assert first == again == copy
    assert provide_unpacked(archive("a.zip", "2")) != first
    for _ in range(3):
        release_unpacked(first)
    assert provide_unpacked(archive()) == first


def test_threads_get_one_folder(archive):
    path = archive(content="threads")
    with ThreadPoolExecutor(8) as pool:
        assert len(set(pool.map(provide_unpacked, [path] * 40))) == 1


def test_a_damaged_folder_is_replaced_when_its_users_are_gone(archive):
    path = archive(content="damaged")
    first = provide_unpacked(path)
    (first / "resources" / "data.txt").unlink()
    second = provide_unpacked(path)
    assert second != first
    assert (second / "resources" / "data.txt").read_text() == "damaged"
    assert first.is_dir()
    release_unpacked(first)
    assert not first.exists()


def test_one_that_wants_it_has_a_folder_of_its_own(archive):
    path = archive(content="alone")
    shared, own, other = provide_unpacked(path), provide_unpacked(path, False), provide_unpacked(path, False)
    assert len({shared, own, other}) == 3
    for folder in (own, other, shared):
        release_unpacked(folder)
    assert [folder.is_dir() for folder in (shared, own, other)] == [True, False, False]


def test_a_discarded_folder_is_not_handed_out_again(archive):
    path = archive(content="fatal")
    folder = provide_unpacked(path)
    discard_unpacked(folder)
    assert folder.is_dir()  # its instance may go on to use it
    assert provide_unpacked(path) != folder


def test_a_file_that_changes_meanwhile_is_refused(archive, monkeypatch):
    path = archive(content="before")
    monkeypatch.setattr(unpacked, "extract", lambda *_: archive(content="after"))
    with pytest.raises(SystemFileError, match="was changed while it was unpacked"):
        provide_unpacked(path)


def test_what_only_others_need_is_left_out(tmp_path):
    needed = {"modelDescription.xml", "model.png", "resources/documentation/a.txt", "resources/binaries/win64/a.dll"}
    needed |= {f"binaries/{name}" for name in (f"{platform}/A.so", f"{platform}/A/deep.so", "vax/A.so")}
    systems = ("linux", "win", "darwin")
    foreign = [f"{name}64" for name in systems if not platform.startswith(name)]
    own = "resources/ps_fmu_1/native/"  # of an FMU of ps_fmu: libraries for all platforms
    needed |= {f"{own}{find_platform()}/a.so", f"{own}__pycache__/a.pyc", f"{own}a.py", "resources/other/native/x/a.so"}
    with zipfile.ZipFile(tmp_path / "a.fmu", "w") as file:
        left = [f"{own}vax/a.so", "documentation/index.html", *(f"binaries/{name}/A.dll" for name in foreign)]
        for name in [*needed, *left]:
            file.writestr(name, name)
    folder = provide_unpacked(tmp_path / "a.fmu")
    assert {str(path.relative_to(folder)) for path in folder.rglob("*") if path.is_file()} == needed
    assert len(foreign) == 2
    release_unpacked(folder)


def test_imports_of_fmus_leave_the_interpreter_as_it_was(monkeypatch):
    monkeypatch.setattr(sys, "dont_write_bytecode", False)
    before = gc.get_threshold()
    for often in (700, 0, 10**6):  # 0: never
        gc.set_threshold(often, *before[1:])
        try:
            with pytest.raises(ZeroDivisionError), unpacked.ease_imports():
                assert sys.dont_write_bytecode
                assert (gc.get_threshold()[0] >= 100_000) == (often > 0)
                raise ZeroDivisionError
            assert gc.get_threshold() == (often, *before[1:])
        finally:
            gc.set_threshold(*before)
    assert not sys.dont_write_bytecode


def test_a_temporary_folder_that_is_cleared_is_made_again(archive):
    path = archive(content="cleared")
    folder = provide_unpacked(path)
    shutil.rmtree(folder.parent)
    again = provide_unpacked(path)
    assert (again / "resources" / "data.txt").read_text() == "cleared"
    release_unpacked(folder)


PROGRAM = """
import os, sys
from pathlib import Path
from ps_fmu.cosim.unpacked import provide_unpacked
path = Path(sys.argv[1])
folder = provide_unpacked(path)
child = os.fork()
if child == 0:
    assert provide_unpacked(path) != folder
    sys.exit(0)
assert os.waitpid(child, 0)[1] == 0
assert folder.is_dir(), "the child removed its parent's folder"
assert len(os.listdir(sys.argv[2])) == 1, "the child left its own"
"""


def test_nothing_stays_behind_and_a_forked_process_leaves_its_parents_folder(archive, tmp_path):
    place = tmp_path / "place"
    place.mkdir()
    environment = {**os.environ, "TMPDIR": str(place)}
    subprocess.run([sys.executable, "-I", "-c", PROGRAM, str(archive()), str(place)], check=True, env=environment)
    assert os.listdir(place) == []


WORKER = """
import multiprocessing, os, sys
from pathlib import Path
from ps_fmu.cosim.unpacked import provide_unpacked
worker = multiprocessing.get_context("fork").Process(target=provide_unpacked, args=(Path(sys.argv[1]),))
worker.start()
worker.join()
assert worker.exitcode == 0
assert os.listdir(sys.argv[2]) == [], "the worker left its own"
"""


def test_a_forked_worker_of_multiprocessing_leaves_no_folder_behind(archive, tmp_path):
    """It calls no functions of atexit."""
    place = tmp_path / "place"
    place.mkdir()
    environment = {**os.environ, "TMPDIR": str(place)}
    command = [sys.executable, "-I", "-c", WORKER, str(archive()), str(place)]
    subprocess.run(command, check=True, env=environment, timeout=300)


@pytest.fixture(autouse=True)
def above(tmp_path, monkeypatch):
    """The folder for temporary files."""
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    return tmp_path


def start(above):
    """A process that has made a folder, and the folder."""
    script = """
        import sys, tempfile
        tempfile.tempdir = sys.argv[1]
        from ps_fmu.cosim.unpacked import make_temporary
        print(make_temporary("fmus_").name, flush=True)
        sys.stdin.read()
    """
    command = [sys.executable, "-I", "-c", textwrap.dedent(script), str(above)]
    process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    return process, above / process.stdout.readline().strip()


def test_what_a_killed_process_has_left_goes(above):
    process, left = start(above)
    (left / "1").mkdir()
    (left / "1" / "library.so").write_text("x")
    with process:
        living = make_temporary("fmus_")  # looks round while the process lives
        assert left.is_dir()
        process.kill()
    unpacked._cleared.clear()
    own = make_temporary("ssp_")
    assert sorted(above.iterdir()) == sorted([living, own])
    for folder in (living, own):
        remove_temporary(folder)
    assert not list(above.iterdir())


def test_what_is_not_ours_stays(above):
    names = ["fmus_without_lock", "other_folder", "fmus_link", "fmus_locked_by_link"]
    for name in names[:2]:
        (above / name).mkdir()
    (above / names[1] / LOCK).touch()
    (above / names[2]).symlink_to(above / names[1])
    (above / names[3]).mkdir()
    (above / names[3] / LOCK).symlink_to(above / names[1] / LOCK)
    (above / "fmus_file").touch()
    own = make_temporary("fmus_")
    assert {path.name for path in above.iterdir()} == {*names, "fmus_file", own.name}
    remove_temporary(own)


def test_a_folder_of_another_user_stays(above, monkeypatch):
    (above / "fmus_theirs").mkdir()
    (above / "fmus_theirs" / LOCK).touch()
    with monkeypatch.context() as patch:
        patch.setattr(unpacked.os, "geteuid", lambda: 12345)
        remove_temporary(make_temporary("fmus_"))
    assert (above / "fmus_theirs").is_dir()
    unpacked._cleared.clear()
    remove_temporary(make_temporary("fmus_"))
    assert not (above / "fmus_theirs").exists()


def test_a_folder_that_may_not_be_listed(above, monkeypatch):
    def refuse(path):
        raise PermissionError(13, "Permission denied", path)

    monkeypatch.setattr(unpacked.os, "scandir", refuse)
    monkeypatch.setattr(unpacked, "_cleared", set())
    folder = make_temporary("fmus_")
    assert folder.is_dir()
    monkeypatch.undo()
    remove_temporary(folder)
