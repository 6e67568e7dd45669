"""The file of rows: what is added is there or not; what is missing; nothing twice."""

import sqlite3

import pytest

from ps_fmu.studies.bundle import Bundle
from ps_fmu.studies.rows import FAILED, FILE, KILLED, SIGNALS, RowStore, list_reasons, write_durably
from ps_fmu.studies.sweep import remove_leftovers

from .conftest import list_missing

PLAN, OTHER = "ab" * 32, "cd" * 32


@pytest.fixture
def store(tmp_path):
    return RowStore(tmp_path, PLAN)


def rows(first, last, **more):
    cases = range(first, last + 1)
    return [{"case": case, "status": "done", "error": None, "value": case / 3.0, **more} for case in cases]


def test_what_is_written_is_read_to_the_last_bit_and_the_rest_is_missing(store, tmp_path):
    assert list_missing(store, 2) == [0, 1]
    assert list(tmp_path.iterdir()) == []  # to look leaves no file
    store.add(rows(4, 6))
    store.add(rows(0, 1))
    RowStore(tmp_path, OTHER).add(rows(2, 3))
    found = store.read_table()
    assert found["case"].to_pylist() == [0, 1, 4, 5, 6]
    assert found["value"].to_pylist() == [case / 3.0 for case in (0, 1, 4, 5, 6)]
    assert list_missing(store, 9) == [2, 3, 7, 8]
    assert RowStore(tmp_path, "ef" * 32).read_table() is None


@pytest.mark.parametrize("value", [float("nan"), float("-inf"), 5e-324, -0.0, 0.1 + 0.2])
def test_any_number_is_read_as_it_was(store, value):
    store.add(rows(0, 0, value=value))
    assert repr(store.read_table()["value"].to_pylist()) == repr([value])


def test_a_case_that_comes_twice_counts_once(store):
    store.add(rows(0, 5, worker="one"))
    store.add(rows(3, 8, worker="two"))
    assert store.read_table()["case"].to_pylist() == list(range(9))
    assert list_missing(store, 9) == []


def test_rows_without_numbers_join_those_with_numbers(store, monkeypatch):
    monkeypatch.setattr("ps_fmu.studies.rows.ROWS_AT_ONCE", 1)
    store.add([{"case": 0, "status": "failed", "error": "why", "v/answer": None, "v/histogram": None}])
    store.add([{"case": 1, "status": "done", "error": None, "v/answer": "met", "v/histogram": "h", "value": 1.0}])
    found = store.read_table()
    assert found["value"].to_pylist() == [None, 1.0]
    assert found["v/answer"].to_pylist() == [None, "met"]
    assert "v/histogram" not in found.column_names
    assert list(store.read_texts("v/histogram")) == ["h"]
    assert [row["status"] for row in store.read(1)] == ["done"]


def test_rows_that_cannot_all_be_added_leave_what_was_there(store):
    store.add(rows(0, 1))
    with pytest.raises(TypeError):
        store.add([*rows(1, 2), {"case": 3, "value": object()}])
    with pytest.raises(OSError, match=r"rows\.sqlite: .*NOT NULL"), store._open() as connection:
        connection.execute("INSERT INTO rows VALUES (7, 'x', NULL)")
    assert list_missing(store, 9) == [2, 3, 4, 5, 6, 7, 8]


@pytest.mark.parametrize("change", ["replace(content, '0.3333333333333333', '0.3333333333333332')", "digest || 'x'"])
def test_a_row_that_a_disk_has_changed_is_computed_again(store, tmp_path, change):
    store.add(rows(0, 2))
    with sqlite3.connect(tmp_path / FILE) as connection:
        name = "content" if "content" in change else "digest"
        connection.execute(f"UPDATE rows SET {name} = {change} WHERE number = 1")
    connection.close()
    assert list_missing(store, 3) == [1]
    store.add(rows(1, 1))
    assert list_missing(store, 3) == []


def test_a_file_that_was_just_made_has_no_rows(store, tmp_path):
    (tmp_path / FILE).touch()
    assert list_missing(store, 2) == [0, 1]


def test_a_file_that_is_damaged_is_named(store, tmp_path):
    (tmp_path / FILE).write_bytes(b"no rows" * 1000)
    for use in (lambda: list_missing(store, 2), lambda: store.add(rows(0, 1))):
        with pytest.raises(OSError, match=r"rows\.sqlite: file is not a database: delete this file, and resume"):
            use()


def test_a_full_disk_leaves_what_was_there(tmp_path, monkeypatch):
    def fail(*_):
        raise OSError(28, "No space left on device")

    (tmp_path / "plan").write_bytes(b"before")
    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="No space left on device") as caught:
        write_durably(tmp_path / "plan", b"after")
    assert caught.value.filename == str(tmp_path / "plan")
    assert [one.read_bytes() for one in tmp_path.iterdir()] == [b"before"]


def test_what_ended_processes_were_writing_is_removed(tmp_path):
    (tmp_path / SIGNALS).mkdir()
    (tmp_path / SIGNALS / ".abc.part").write_bytes(b"CDF")
    remove_leftovers(tmp_path)
    assert list((tmp_path / SIGNALS).iterdir()) == []


def test_files_that_cannot_all_be_unpacked_leave_none(tmp_path):
    with pytest.raises(OSError, match="task"):
        Bundle.of({"task": b"", "task/more": b""}).unpack(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_errors_that_differ_in_numbers_or_folders_have_one_reason():
    texts = [
        *(f"delay: {delay:.6g} s is no multiple of 0.0001 s\n in /tmp/study_{n}/fmus/0/A.fmu" for n, delay in
          ((0, 0.00282833), (1, -1.5e-05), (2, 3.0))),
        "delay: 1 s is no multiple of 0.0001 s\n in /tmp/study_9/fmus/0/B.fmu",
        "fmi2Error at 1 s", "fmi3Error at 1 s", "x" * 1000,
    ]  # fmt: skip
    lines = list_reasons([(7 + n, FAILED, text) for n, text in enumerate(texts)] + [(20, KILLED, texts[0])])
    first = "3 failed, as case 7: delay: 0.00282833 s is no multiple of 0.0001 s in /tmp/study_0/fmus/0/A.fmu"
    assert lines[0] == first
    assert lines[1].endswith("B.fmu") and lines[2] == "1 failed, as case 11: fmi2Error at 1 s"
    assert lines[3:] == ["3 for 3 other reasons"]
    assert list_reasons([]) == []
