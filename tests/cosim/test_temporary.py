"""Temporary folders: those of killed processes go, those of living processes and of others stay."""

import subprocess
import sys
import tempfile
import textwrap

import pytest

from ps_fmu.cosim import unpacked
from ps_fmu.cosim.unpacked import LOCK, make_temporary, remove_temporary


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
