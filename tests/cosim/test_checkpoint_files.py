"""Files of checkpoints: what goes in comes out, to the last bit; what is damaged is refused; how often they come."""

import math
import os
import signal
import zlib
from itertools import count

import msgspec
import numpy as np
import pytest
from support.checkpoints import STEPS, H, Keep, check_same, run

from ps_fmu.cosim import Master, UsageError
from ps_fmu.cosim.checkpoint import files
from ps_fmu.cosim.checkpoint.checkpoints import LOOK_S, Checkpoints, Pace
from ps_fmu.cosim.checkpoint.files import CheckpointFolder, Journal, read_file, write_file
from ps_fmu.cosim.checkpoint.state import CheckpointError

RNG = np.random.default_rng(3)
TREE = {
    "numbers": [1, 2**63, 0.1, -0.0, math.inf, -math.inf, True, None, "text \u20ac"],
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
    write_file(tmp_path / "a.msgpack", TREE | {"nan": math.nan})
    found = read_file(tmp_path / "a.msgpack")
    assert math.isnan(found.pop("nan"))
    assert found["numbers"] == TREE["numbers"]
    assert math.copysign(1.0, found["numbers"][3]) == -1.0
    assert (found["state"], found["nothing"]) == (TREE["state"], b"")
    assert found["arrays"].keys() == TREE["arrays"].keys()
    for name, array in TREE["arrays"].items():
        own = found["arrays"][name]
        assert (own.dtype, own.shape, own.tobytes()) == (array.dtype, array.shape, array.tobytes())
    assert found["arrays"]["columns"].flags.f_contiguous  # numpy sums in the order of the memory
    assert [path.name for path in tmp_path.iterdir()] == ["a.msgpack"]


@pytest.mark.parametrize("value", [object(), np.array(["text"]), np.zeros(2, complex)])
def test_what_a_checkpoint_cannot_hold_is_a_mistake_of_ours(tmp_path, value):
    with pytest.raises(TypeError, match="a checkpoint cannot store a"):
        write_file(tmp_path / "a.msgpack", {"value": value})
    assert list(tmp_path.iterdir()) == []


def test_a_pipe_is_not_read(tmp_path):
    """Nobody writes into it: reading would wait for ever."""
    os.mkfifo(tmp_path / "a.msgpack")
    for path in (tmp_path / "a.msgpack", tmp_path):
        with pytest.raises(CheckpointError, match=f"{path.name}: is a folder, pipe or device"):
            read_file(path)


def array(dtype="<f8", shape=(1,), columns=False, begin=0, code=1):
    return {"a": msgspec.msgpack.Ext(code, msgspec.msgpack.encode((dtype, shape, columns, begin)))}


@pytest.mark.parametrize(
    "content",
    [
        b"", b"\xc1", b"\x93", b"\x91" * 100_000, b"\xdd\xff\xff\xff\xff", [], array("|O"), array(shape=(2,)),
        array(shape=(-1,)), array(shape=(2**47, 2**47)), array(shape=(2**62, 2**62)), array(shape="1"),
        array(begin=1), array(begin=-8), array(begin=2**62), array(code=5), {"a": msgspec.msgpack.Ext(1, b"text")},
    ],
)  # fmt: skip
def test_what_is_made_up_is_refused(tmp_path, content):
    raw = content if isinstance(content, bytes) else msgspec.msgpack.encode(content)
    path = tmp_path / "a.msgpack"
    for size in (len(raw), 2**40, -1):
        head = b"ps_fmu checkpoint 3 %d %08x\n" % (size, zlib.crc32(raw + bytes(8)))
        path.write_bytes(head + raw + bytes(8))
        with pytest.raises(CheckpointError, match=r"a\.msgpack: is not a checkpoint, or is damaged"):
            read_file(path)


def test_each_missing_and_each_wrong_byte_is_found(tmp_path):
    path = tmp_path / "a.msgpack"
    write_file(path, {"a": np.arange(6.0), "b": "text"})
    good = path.read_bytes()
    for length in range(0, len(good), 7):
        path.write_bytes(good[:length])
        with pytest.raises(CheckpointError):
            read_file(path)
    start = good.index(np.arange(6.0).tobytes())
    path.write_bytes(good[: start + 9] + b"\x07" + good[start + 10 :])
    with pytest.raises(CheckpointError, match="its checksum"):
        read_file(path)
    with pytest.raises(CheckpointError, match="cannot be read: No such file"):
        read_file(tmp_path / "nothing.msgpack")


def test_two_generations_stay(tmp_path):
    folder = CheckpointFolder(tmp_path / "kept")
    assert folder.read() is None
    for index in (5, 900, 1_000_000_000_000, 77):
        folder.write(index, {"index": index})
    assert [path.name for path in folder.list_files()] == ["row-1000000000000.msgpack", "row-000000000900.msgpack"]
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


def test_links_of_a_folder_from_elsewhere_are_not_followed(tmp_path):
    other, kept = tmp_path / "other", tmp_path / "kept"
    other.write_text("mine")
    kept.mkdir()
    for name in ("row-000000000001.msgpack", ".begun.part"):
        (kept / name).symlink_to(other)
    folder = CheckpointFolder(kept)
    for index in range(1, 9):
        folder.write(index, {"index": index})
        assert folder.read()[1]["index"] == index
    assert other.read_text() == "mine"
    folder.leave_last()
    assert [path.name for path in kept.iterdir()] == ["row-000000000008.msgpack"]


def read_journal(journal):
    """All its rows, row by row."""
    return np.concatenate(list(journal.read())).tobytes()


@pytest.mark.parametrize("width", [1, 8, 9, 95])
def test_rows_of_a_journal_keep_their_bits(tmp_path, width):
    """Zeros of both signs, numbers that are none, and columns that change once, early, late or never."""
    rows = np.zeros((files.PART_ROWS + 9, width))
    rows[:, ::3] = RNG.normal(size=rows[:, ::3].shape)
    for place, value in ((0, -0.0), (1, 5.0), (len(rows) // 3, math.nan), (len(rows) - 1, -0.0)):
        rows[place, place % width] = value
    journal = Journal(tmp_path / "rows.bin", width)
    for begin, end in ((0, 1), (1, 3), (3, 3), (3, len(rows))):
        journal.append(rows[begin:end])
    kept = journal.sync()
    journal.close()
    again = Journal(tmp_path / "rows.bin", width, kept)
    assert read_journal(again) == rows.tobytes()
    again.close()


def test_a_journal_is_cut_where_the_checkpoint_is(tmp_path):
    path, rows = tmp_path / "rows.bin", RNG.normal(size=(50, 3))
    rows[:, 1], rows[25, 2] = -0.0, math.nan
    journal = Journal(path, 3)
    journal.append(rows[:20])
    journal.append(rows[20:20])
    journal.append(np.asfortranarray(rows[20:30]))
    kept = journal.sync()
    journal.append(rows[30:])
    journal.close()
    journal.append(rows)  # after the run: in no checkpoint
    again = Journal(path, 3, kept)
    assert read_journal(again) == rows[:30].tobytes()
    again.append(rows[30:])
    assert read_journal(again) == rows.tobytes()
    size = again.sync()["bytes"]
    assert size < rows.nbytes  # a column that does not change is one number
    again.close()
    for changed, words in (
        ({"bytes": size + 8}, f"ends within the {size + 8} bytes"),
        ({"sum": 5}, "is damaged"),
        ({"bytes": kept["bytes"] - 8}, "is damaged"),
        ({"width": 4}, "expected rows of 3 numbers"),
        ({"bytes": -1}, "expected rows"),
        ({"bytes": "all"}, "expected rows"),
    ):
        with pytest.raises(CheckpointError, match=words):
            Journal(path, 3, kept | changed)
    path.unlink()
    with pytest.raises(CheckpointError, match="No such file"):
        Journal(path, 3, kept)


def test_what_a_kill_has_torn_or_a_disk_has_changed_is_refused(tmp_path):
    path = tmp_path / "rows.bin"
    journal = Journal(path, 3)
    rows = np.column_stack([np.arange(50.0), np.ones(50), np.arange(50.0)])
    journal.append(rows)
    kept = journal.sync()
    journal.close()
    good = path.read_bytes()
    assert len(good) == 8 * (2 + 50 + 1 + 50)  # rows and columns that differ, then these
    for length in (0, 7, 15, 16, len(good) - 1):
        path.write_bytes(good[:length])
        with pytest.raises(CheckpointError, match=f"ends within the {len(good)} bytes"):
            Journal(path, 3, kept)
    for number in (0, 51, 2**63):
        path.write_bytes(number.to_bytes(8, "little") + good[8:])
        with pytest.raises(CheckpointError, match=f"ends within the {len(good)} bytes"):
            Journal(path, 3, kept)
    path.write_bytes(good[:-1] + b"\x41")
    with pytest.raises(CheckpointError, match=r"is damaged: the checksum .*: start the run again"):
        Journal(path, 3, kept)


def test_a_write_that_takes_a_part_goes_on_with_the_rest(tmp_path):
    class Slow:
        closed = False

        def __init__(self, file):
            self.file = file

        def write(self, data):
            return self.file.write(data[:1003])

        def __getattr__(self, name):
            return getattr(self.file, name)

    rows = RNG.normal(size=(90, 60))
    journal = Journal(tmp_path / "rows.bin", 60)
    journal._file = Slow(journal._file)
    journal.append(np.asfortranarray(rows))
    kept = journal.sync()
    journal.close()
    assert read_journal(Journal(tmp_path / "rows.bin", 60, kept)) == rows.tobytes()


class Clock:
    """Shows the time that it was set to [s]."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture
def clock():
    return Clock()


@pytest.fixture
def written(monkeypatch):
    """The communication points of the checkpoints that are written, in their order."""
    original, found = CheckpointFolder.write, []

    def write(self, index, tree):
        found.append(index)
        return original(self, index, tree)

    monkeypatch.setattr(CheckpointFolder, "write", write)
    return found


def take(pace, clock, rows_s=0.0):
    """A checkpoint that takes 0.4 s; when it began."""
    with pace.count(rows_s):
        clock.now += 0.4
    return clock.now - 0.4


def test_the_first_one_does_not_wait(clock):
    assert Pace(1e-9, clock).is_paid(1e9)


def test_one_is_paid_for_by_the_time_since_it_began(clock):
    pace = Pace(0.02, clock)
    began = take(pace, clock)
    for since, paid in ((19.99, False), (20.01, True), (1000.0, True)):
        clock.now = began + since
        assert pace.is_paid(0.0) is paid


def test_rows_of_journals_count_but_leave_a_quarter(clock):
    pace = Pace(0.02, clock)
    began = take(pace, clock, rows_s=7.0)
    clock.now = began + 30.0
    assert pace.is_paid(7.19)
    assert not pace.is_paid(7.21)
    clock.now = began + 79.9
    assert not pace.is_paid(50.0)
    clock.now = began + 80.1
    assert pace.is_paid(50.0)


def test_without_a_share_none_waits(clock):
    pace = Pace(None, clock)
    take(pace, clock)
    assert pace.is_paid(1e9)


def test_one_that_waits_is_not_looked_at_too_often(clock):
    pace = Pace(0.02, clock)
    pace.start(500)
    clock.now += 0.5
    assert pace.find_next_look(50_500) == 50_500 + 50_000 * LOOK_S / 0.5
    clock.now += 1e9
    assert pace.find_next_look(50_500) == 50_501
    pace.start(0)
    assert pace.find_next_look(7) == 8  # no time has passed


@pytest.mark.parametrize("share", [0.0, -0.02, float("nan")])
def test_an_impossible_share_is_refused(tmp_path, share):
    with pytest.raises(UsageError, match="expected a share of the time above 0"):
        Checkpoints(tmp_path, 1.0, share=share)


def test_without_a_share_they_come_when_they_are_due(mixed, tmp_path, written):
    run(mixed, Checkpoints(tmp_path, 0.1))
    assert written == [10, 20, 30, 40, 50, 60]


def test_where_none_can_be_paid_the_first_and_the_last_are_taken(mixed, tmp_path, written):
    """Results are those of a run without checkpoints, and the last one is at the end of the run."""
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9)), run(mixed))
    assert written == [5, STEPS]
    again = run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9, resume=True))
    check_same(again, run(mixed))


def test_a_run_that_is_killed_while_one_waits_goes_on(mixed, tmp_path, written):
    run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9), stop_s=0.4)
    assert written == [5]
    check_same(run(mixed, Checkpoints(tmp_path, 0.05, share=1e-9, resume=True)), run(mixed))
    assert written == [5, 10, STEPS]  # the first one of that run does not wait


def test_one_that_waits_is_taken_at_a_multiple_of_the_interval(mixed, tmp_path, written, monkeypatch):
    """By a clock that goes on by 1 s whenever it is read: a checkpoint takes 1 s, to look at one takes 1 s."""
    ticks = count(1.0)
    module = "ps_fmu.cosim.checkpoint.checkpoints.Pace"
    monkeypatch.setattr(module, lambda share: Pace(share, lambda: next(ticks)))
    run(mixed, Checkpoints(tmp_path, 2 * H, share=0.1))
    assert written == [2, 12, 22, 32, 42, 52, STEPS]


def test_ctrl_c_does_not_wait(mixed, tmp_path, written):
    def press(simulated, _wall, _factor):
        if simulated >= 0.26 and not pressed:
            pressed.append(simulated)
            signal.raise_signal(signal.SIGINT)

    pressed, keep = [], Keep()
    with pytest.raises(KeyboardInterrupt), Master(mixed, H, block_rows=7) as master:
        master.initialise()
        master.run(STEPS * H, [keep], (), press, checkpoints=Checkpoints(tmp_path, 0.1, share=1e-9))
    assert written == [10, len(keep.time) - 1]
    assert written[1] < STEPS
