"""Files of checkpoints: what goes in comes out, to the last bit; what is damaged or made up is refused."""

import json
import math
import os
import struct
import zipfile
from itertools import pairwise

import numpy as np
import pytest

from ps_fmu.cosim.checkpoint.files import read_file, write_file
from ps_fmu.cosim.checkpoint.folder import CheckpointFolder
from ps_fmu.cosim.checkpoint.journal import Journal
from ps_fmu.cosim.checkpoint.state import CheckpointError

RNG = np.random.default_rng(3)
TREE = {
    "numbers": [1, 2**70, 0.1, -0.0, math.inf, -math.inf, True, None, "text \u20ac"],
    "arrays": {
        "plain": RNG.normal(size=(3, 4)),
        "columns": np.asfortranarray(RNG.normal(size=(3, 4))),
        "cut": RNG.normal(size=(3, 8))[:, ::2],
        "empty": np.zeros((0, 5)),
        "single": np.array(2.5),
        "whole": np.arange(5),
        "small": np.arange(5, dtype=np.int32),
        "flags": np.array([True, False]),
        "not numbers": np.array([math.nan, math.inf]),
    },
    "state": bytes(range(256)),
    "nothing": b"",
}


def test_what_goes_in_comes_out(tmp_path):
    write_file(tmp_path / "a.zip", TREE | {"nan": math.nan})
    found = read_file(tmp_path / "a.zip")
    assert math.isnan(found.pop("nan"))
    assert found["numbers"] == TREE["numbers"]
    assert math.copysign(1.0, found["numbers"][3]) == -1.0
    assert (found["state"], found["nothing"]) == (TREE["state"], b"")
    assert found["arrays"].keys() == TREE["arrays"].keys()
    for name, array in TREE["arrays"].items():
        own = found["arrays"][name]
        assert (own.dtype, own.shape, own.tobytes()) == (array.dtype, array.shape, array.tobytes())
    assert found["arrays"]["columns"].flags.f_contiguous  # numpy sums in the order of the memory
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


@pytest.mark.parametrize("value", [{1: 2}, {"$array": 1}, object(), np.array(["text"]), np.zeros(2, complex)])
def test_what_a_checkpoint_cannot_hold_is_a_mistake_of_ours(tmp_path, value):
    with pytest.raises(TypeError, match="a checkpoint holds no"):
        write_file(tmp_path / "a.zip", {"value": value})
    assert list(tmp_path.iterdir()) == []


def make(path, head, data=b"", compression=zipfile.ZIP_STORED):
    with zipfile.ZipFile(path, "w", compression) as archive:
        archive.writestr("checkpoint.json", head if isinstance(head, str) else json.dumps(head))
        archive.writestr("arrays.bin", data)
    return path


def head(content=None, arrays=(), **others):
    return {"format": 1, "arrays": list(arrays), "content": {} if content is None else content, **others}


def entry(**changes):
    return {"dtype": "<f8", "size": 1, "offset": 0, **changes}


MADE_UP = {
    "another format": head(format=2),
    "no format": {},
    "a list": [],
    "no JSON": "{",
    "deep": "[" * 100_000,
    "no content": head([]),
    "an object": head(arrays=[entry(dtype="|O")]),
    "too long": head(arrays=[entry(size=2)]),
    "behind the end": head(arrays=[entry(offset=1)]),
    "negative": head(arrays=[entry(size=-1)]),
    "enormous": head(arrays=[entry(size=2**60)]),
    "no number": head(arrays=[entry(size="1")]),
    "another array": head({"a": {"$array": 5, "shape": [1], "by_columns": False}}, [entry()]),
    "another shape": head({"a": {"$array": 0, "shape": [2], "by_columns": False}}, [entry()]),
    "an enormous shape": head({"a": {"$array": 0, "shape": [2**47, 2**47], "by_columns": False}}, [entry()]),
    "an array twice": head({"a": {"$bytes": 0}, "b": {"$bytes": 0}}, [entry()]),
    "arrays in one place": head(arrays=[entry(), entry()]),
    "a wrong number": head({"a": {"$number": "1+1"}}),
}


@pytest.mark.parametrize("name", MADE_UP)
def test_what_is_made_up_is_refused(tmp_path, name):
    path = make(tmp_path / "a.zip", MADE_UP[name], struct.pack("<d", 1.0))
    with pytest.raises(CheckpointError, match=r"a\.zip: is no checkpoint, or a damaged one"):
        read_file(path)


def test_what_is_compressed_could_be_of_any_size(tmp_path):
    with pytest.raises(CheckpointError, match="is compressed"):
        read_file(make(tmp_path / "a.zip", head(), bytes(10**6), zipfile.ZIP_DEFLATED))


def test_each_missing_and_each_wrong_byte_is_found(tmp_path):
    path = tmp_path / "a.zip"
    write_file(path, {"a": np.arange(6.0), "b": "text"})
    good = path.read_bytes()
    for length in range(0, len(good), 7):
        path.write_bytes(good[:length])
        with pytest.raises(CheckpointError):
            read_file(path)
    start = good.index(np.arange(6.0).tobytes())
    path.write_bytes(good[: start + 9] + b"\x07" + good[start + 10 :])
    with pytest.raises(CheckpointError, match="CRC"):
        read_file(path)
    with pytest.raises(CheckpointError, match="cannot be read: No such file"):
        read_file(tmp_path / "nothing.zip")


def test_two_generations_stay(tmp_path):
    folder = CheckpointFolder(tmp_path / "kept")
    assert folder.read() is None
    for index in (5, 900, 1_000_000_000_000, 77):
        folder.write(index, {"index": index})
    assert [path.name for path in folder.list_files()] == ["row-1000000000000.zip", "row-000000000900.zip"]
    (tmp_path / "kept" / "notes.txt").write_text("mine")
    folder.clear()
    assert [path.name for path in (tmp_path / "kept").iterdir()] == ["notes.txt"]


def test_a_file_that_cannot_be_written_leaves_the_others(tmp_path, monkeypatch):
    folder = CheckpointFolder(tmp_path)
    folder.write(1, {"index": 1})

    def fail(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", fail)
    with pytest.raises(OSError, match="No space"):
        folder.write(2, {"index": 2})
    assert folder.read()[1] == {"index": 1}
    assert len(list(tmp_path.iterdir())) == 1


def test_an_old_file_is_written_over_if_it_is_our_own(tmp_path):
    """A folder from elsewhere may have links in it, to any file."""
    other, kept = tmp_path / "other", tmp_path / "kept"
    other.write_text("mine")
    kept.mkdir()
    for name in ("row-000000000001.zip", ".begun.part"):
        (kept / name).symlink_to(other)
    folder = CheckpointFolder(kept)
    for index in range(2, 9):
        folder.write(index, {"index": index, "rows": np.arange(1000 - 100 * index)})
        assert folder.read()[1]["index"] == index
    assert [path.name for path in folder.list_files()] == ["row-000000000008.zip", "row-000000000007.zip"]
    assert other.read_text() == "mine"
    assert folder.list_files()[0].stat().st_size < folder.list_files()[1].stat().st_size  # what was longer is cut
    folder.leave_last()
    assert [path.name for path in kept.iterdir()] == ["row-000000000008.zip"]


def test_a_journal_is_cut_where_the_checkpoint_is(tmp_path):
    path, rows = tmp_path / "rows.bin", RNG.normal(size=(50, 3))
    journal = Journal(path, 3)
    journal.append(rows[:20])
    journal.append(rows[20:20])
    journal.append(np.asfortranarray(rows[20:30]))
    kept = journal.sync()
    journal.append(rows[30:])
    journal.close()
    journal.append(rows)  # after the run: in no checkpoint
    again = Journal(path, 3, kept)
    np.testing.assert_array_equal(np.concatenate(list(again.read())), rows[:30])
    again.append(rows[30:])
    np.testing.assert_array_equal(np.concatenate(list(again.read())), rows)
    assert again.sync()["rows"] == 50
    again.close()
    for changed, words in (
        ({"rows": 51}, "ends before the 51 rows"),
        ({"sum": 5}, "is damaged"),
        ({"rows": 29}, "is damaged"),
        ({"width": 4}, "expected rows of 3 numbers"),
        ({"rows": -1}, "expected rows"),
        ({"rows": "all"}, "expected rows"),
    ):
        with pytest.raises(CheckpointError, match=words):
            Journal(path, 3, kept | changed)
    path.unlink()
    with pytest.raises(CheckpointError, match="No such file"):
        Journal(path, 3, kept)


@pytest.mark.parametrize("system", ["writes a part", "has no writev"])
def test_a_journal_is_whole_however_the_system_writes(tmp_path, system, monkeypatch):
    rows = RNG.normal(size=(900, 600))
    rows[:, 7] = -0.0
    if system == "has no writev":
        monkeypatch.delattr(os, "writev")
    else:
        monkeypatch.setattr(os, "writev", lambda file, pieces: os.write(file, b"".join(pieces)[:100_003]))
    journal = Journal(tmp_path / "rows.bin", 600)
    journal.append(np.asfortranarray(rows))
    kept = journal.sync()
    journal.close()
    monkeypatch.undo()
    found = np.concatenate(list(Journal(tmp_path / "rows.bin", 600, kept).read()))
    assert found.tobytes() == rows.tobytes()


@pytest.mark.parametrize("width", [1, 7, 8, 95])
def test_columns_of_one_value_come_back_to_the_last_bit(tmp_path, width, monkeypatch):
    monkeypatch.setattr("ps_fmu.cosim.checkpoint.journal.MOST_BLOCK_BYTES", 100_000)  # some blocks for the last piece
    path, rows = tmp_path / "rows.bin", RNG.normal(size=(900, width))
    rows[:, ::3] = RNG.normal(size=len(range(0, width, 3)))
    rows[:, 0] = math.nan
    rows[500:, ::4] = -0.0
    rows[501:, ::4] = 0.0  # is equal, but has other bits
    journal, pieces = Journal(path, width), (0, 1, 40, 400, 900)
    for first, last in pairwise(pieces):
        journal.append(np.asfortranarray(rows[first:last]) if first else rows[first:last])
    kept = journal.sync()
    assert np.concatenate(list(journal.read())).tobytes() == rows.tobytes()
    journal.close()
    again = Journal(path, width, kept)
    assert np.concatenate(list(again.read())).tobytes() == rows.tobytes()
    again.close()
    assert path.stat().st_size < (0.8 if width > 1 else 1.0) * rows.nbytes


def test_an_enormous_block_is_refused(tmp_path):
    """A block of columns that keep their value has as many rows as it says."""
    path = tmp_path / "rows.bin"
    journal = Journal(path, 3)
    journal.append(np.ones((50, 3)))
    kept = journal.sync()
    journal.close()
    good = path.read_bytes()
    assert len(good) == 8 * (1 + 1 + 3)
    for place, value in ((0, 2**40), (0, 0), (0, -1), (8, 2), (11, 1)):
        wrong = struct.pack("<q", value) if place == 0 else bytes([value])
        path.write_bytes(good[:place] + wrong + good[place + len(wrong) :])
        with pytest.raises(CheckpointError, match=r"is damaged: a block of .*: the run cannot go on, begin it anew"):
            Journal(path, 3, kept)
    for length in (0, 7, 15, 39):
        path.write_bytes(good[:length])
        with pytest.raises(CheckpointError, match="ends before the 50 rows"):
            Journal(path, 3, kept)
    path.write_bytes(good[:-1] + b"\x41")
    with pytest.raises(CheckpointError, match="checksum"):
        Journal(path, 3, kept)
