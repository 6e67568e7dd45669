"""Part files: complete or not there; what is missing; nothing twice."""

import errno
import io
import os
import struct

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from ps_fmu.studies.bundle import Bundle
from ps_fmu.studies.parts import FOLDER, list_missing, list_parts, read_rows, write_part
from ps_fmu.studies.signals import FOLDER as SIGNALS
from ps_fmu.studies.stored import remove_leftovers

PLAN, OTHER = "ab" * 32, "cd" * 32


@pytest.fixture
def folder(tmp_path):
    (tmp_path / FOLDER).mkdir()
    return tmp_path


def rows(first, last, **more):
    cases = range(first, last + 1)
    return [{"case": case, "status": "done", "error": None, "value": case / 3.0, **more} for case in cases]


def test_what_is_written_is_read_to_the_last_bit_and_the_rest_is_missing(folder):
    write_part(folder, PLAN, rows(4, 6))
    write_part(folder, PLAN, rows(0, 1))
    write_part(folder, OTHER, rows(2, 3))
    found = read_rows(list_parts(folder, PLAN))
    assert found["case"].to_pylist() == [0, 1, 4, 5, 6]
    assert found["value"].to_pylist() == [case / 3.0 for case in (0, 1, 4, 5, 6)]
    assert list_missing(folder, PLAN, 9) == [2, 3, 7, 8]
    assert read_rows(list_parts(folder, "ef" * 32)) is None


def test_a_case_in_two_parts_counts_once(folder):
    write_part(folder, PLAN, rows(0, 5, worker="one"))
    write_part(folder, PLAN, rows(3, 8, worker="two"))
    assert read_rows(list_parts(folder, PLAN))["case"].to_pylist() == list(range(9))
    assert list_missing(folder, PLAN, 9) == []


def test_a_part_without_numbers_joins_one_with_numbers(folder):
    write_part(folder, PLAN, [{"case": 0, "status": "failed", "error": "why", "v/answer": None}])
    write_part(folder, PLAN, [{"case": 1, "status": "done", "error": None, "v/answer": "met", "value": 1.0}])
    found = read_rows(list_parts(folder, PLAN))
    assert found["value"].to_pylist() == [None, 1.0]
    assert found["v/answer"].to_pylist() == [None, "met"]


@pytest.mark.parametrize("call", ["fsync", "replace"])
def test_a_full_disk_leaves_what_was_there(folder, monkeypatch, call):
    path = write_part(folder, PLAN, rows(0, 1))
    before = path.read_bytes()

    def fail(*_):
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, call, fail)
    with pytest.raises(OSError, match="No space left on device") as caught:
        write_part(folder, PLAN, rows(0, 1, value=7.0))
    assert caught.value.filename.startswith(str(path)[:-24])
    monkeypatch.undo()
    assert [one.name for one in (folder / FOLDER).iterdir()] == [path.name]
    assert path.read_bytes() == before


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"case": ["a", "b"]}, "case is of the type string, expected int64"),
        ({"case": [0, None]}, "case is not in each row"),
        ({"status": None}, "status"),
        ({"status": [1, 2]}, "status is of the type int64"),
        ({"x.rms": ["a", "b"]}, "x.rms is of the type string, expected double"),
    ],
)
def test_a_part_with_other_columns_is_named(folder, change, problem):
    columns = pq.read_table(write_part(folder, PLAN, rows(0, 1))).to_pydict() | change
    forged = io.BytesIO()
    pq.write_table(pa.table({name: values for name, values in columns.items() if values is not None}), forged)
    path = write_part(folder, PLAN, rows(0, 1), forged.getvalue())
    with pytest.raises(OSError, match=f"{problem}.*: delete this part, and resume"):
        read_rows([path])


def cut(path):
    path.write_bytes(path.read_bytes()[:-20])
    return path


def flip(path):
    """A bit of a value, which stays a number."""
    content = bytearray(path.read_bytes())
    content[content.index(struct.pack("<d", 1.0 / 3.0)) + 4] ^= 1
    path.write_bytes(content)
    return path


def rename(path):
    """A part of another study under the name of this one."""
    other = write_part(path.parents[1], OTHER, rows(0, 1, value=7.0))
    path.unlink()
    return other.rename(path.with_name(PLAN[:16] + other.name[16:]))


@pytest.mark.parametrize("change", [cut, flip, rename])
def test_a_part_that_is_damaged_or_of_another_study_is_named(folder, change):
    path = change(write_part(folder, PLAN, rows(0, 1)))
    for read in (lambda: list_missing(folder, PLAN, 2), lambda: read_rows([path])):
        with pytest.raises(OSError, match="delete this part, and resume"):
            read()


def test_what_ended_processes_were_writing_is_removed(folder):
    path = write_part(folder, PLAN, rows(0, 1))
    (folder / SIGNALS).mkdir()
    for name in (FOLDER, SIGNALS):
        (folder / name / ".abc.part").write_bytes(b"PAR1")
    remove_leftovers(folder)
    assert list(folder.glob("*/*")) == [path]


def test_files_that_cannot_all_be_unpacked_leave_none(tmp_path):
    with pytest.raises(OSError, match="task"):
        Bundle.of({"task": b"", "task/more": b""}).unpack(tmp_path)
    assert list(tmp_path.iterdir()) == []
