"""Tables whose rows compiled calls make, one at a time, while the table before is in use."""

import numpy as np
import pytest

from ps_fmu.numerics.calls import Calls
from ps_fmu.numerics.library import find_address
from ps_fmu.numerics.normal import make_calls, make_words
from ps_fmu.slavekit.author.slave import ModelError, Port, Slave

H = 0.01  # s
BLOCK = 4  # rows that a call makes


class Drawn(Slave):
    """Random numbers that belong to the number of the step, two a row, times a gain."""

    ports = (
        Port("one", "output"),
        Port("other", "output"),
        Port("gain", "input", start=1.0, event=True),
    )
    n_memory = 1  # gain
    block_rows = 64
    calls = Calls

    def configure(self) -> None:
        self.made: list[Calls] = []
        self.ends: list[int] = []
        self.memory[0] = self.value("gain")

    def rows(self, t, h, n):
        yield n
        gain, first = self.memory[0], round(t / h)
        begin, end = first // BLOCK, -(-(first + n) // BLOCK)
        drawn = np.empty((end - begin, 2 * BLOCK))
        self.made.append(self.calls(make_calls(make_words((5, begin)), BLOCK, drawn, 1), drawn))
        yield from self.made[-1]
        self.ends.append(self._core.count)
        return gain * drawn.reshape(-1, 2)[first - begin * BLOCK :][:n]

    def event(self, t, h):
        self.memory[0] = self.value("gain")
        self.discard_rows()
        return False

    def restore(self) -> None:
        self.made, self.ends = [], []


def expected(first: int, n: int, gain: float = 1.0) -> list[list[float]]:
    drawn = np.empty(((first + n) // BLOCK + 1, 2 * BLOCK))
    Calls(make_calls(make_words((5, 0)), BLOCK, drawn, 1), drawn).finish()
    return (gain * drawn.reshape(-1, 2)[first : first + n]).tolist()


def start(model: type[Slave] = Drawn) -> Slave:
    slave = model(instance_name="drawn")
    slave.setup_experiment(0.0)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    return slave


def run(slave: Slave, n: int, h: float = H) -> list[list[float]]:
    rows = []
    for _ in range(n):
        assert slave.do_step(slave.time, h)
        rows.append(slave.y.tolist())
    return rows


def test_each_call_has_a_step_of_its_own():
    slave = start()
    assert run(slave, 80) == expected(0, 80)
    left = []
    for _ in range(64):
        run(slave, 1)
        left.append(slave.made[-1].left)
    begun = left.index(max(left))
    assert set(np.diff(left[begun:])) == {0, -1}
    assert left[-1] == 0
    assert slave.ends[-1] < 144  # before its table is needed
    assert run(slave, 300) == expected(144, 300)


def test_calls_that_are_out_of_date_are_dropped():
    slave = start()
    run(slave, 110)
    assert 0 < slave.made[-1].left < len(slave.made) + 16
    old = slave.made[-1]
    waiting = old.left
    slave.set_real([slave.layout.find("gain")], [3.0])
    assert run(slave, 200) == expected(110, 200, 3.0)
    assert old.left == waiting


def test_another_step_size_drops_them_too():
    slave = start()
    run(slave, 110)
    old, waiting = slave.made[-1], slave.made[-1].left
    assert waiting > 0
    run(slave, 100, 2 * H)
    assert old.left == waiting


def test_states_go_back_and_forth_between_calls():
    slave = start()
    run(slave, 100)
    kept = slave._get_fmu_state()
    content = slave._fmu_state_to_bytes(kept)
    later = run(slave, 200)
    slave._set_fmu_state(kept)
    assert run(slave, 200) == later == expected(100, 200)
    other = start()
    run(other, 37)
    other._set_fmu_state(other._fmu_state_from_bytes(content))
    assert run(other, 200) == later


def test_who_goes_on_makes_the_calls_that_are_left():
    drawn = np.empty((6, 2 * BLOCK))
    calls = Calls(make_calls(make_words((5, 0)), BLOCK, drawn, 1), drawn)
    parts = iter(calls.put_before(2))
    assert next(parts) is calls
    assert (calls.left, calls.later) == (6, 3)
    calls.make_next()
    assert calls.left == 5
    assert list(parts) == []
    assert calls.left == 0
    assert drawn.reshape(-1, 2).tolist() == expected(0, 24)


def test_no_calls_at_all_are_not_waited_for():
    assert list(Calls([])) == []


def test_calls_of_several_rows_make_as_many_as_there_are():
    drawn = np.empty((5, 2 * BLOCK))
    calls = Calls(make_calls(make_words((5, 0)), BLOCK, drawn, 2), drawn)
    assert calls.left == 3
    assert find_address(drawn) != 0
    calls.finish()
    assert drawn.reshape(-1, 2).tolist() == expected(0, 20)


class Broken(Slave):
    """The time, and in step 100 infinity."""

    ports = (Port("time", "output", "s"),)
    block_rows = 64

    def rows(self, t, h, n):
        yield 1
        times = self.times(t, h, n)
        return np.where(np.arange(n) + round(t / h) == 99, np.inf, times)[:, np.newaxis]


def test_a_row_that_is_not_finite_is_refused_at_its_step():
    slave = start(Broken)
    assert run(slave, 99) == [[k * H] for k in range(1, 100)]
    for _ in range(2):
        before = slave._fmu_state_to_bytes(slave._get_fmu_state())
        with pytest.raises(ModelError, match=r"t = 0\.99 s refused: Broken\.rows has elements that are not finite"):
            slave.do_step(slave.time, H)
        assert slave._fmu_state_to_bytes(slave._get_fmu_state()) == before


class Interrupted(Calls):
    """Calls of which Ctrl-C, once, ends one that is counted already."""

    due = True

    def make_next(self) -> None:
        if self.due and self.left == 5:
            Interrupted.due = False
            self._words.next += 1
            raise KeyboardInterrupt
        super().make_next()


class OftenInterrupted(Drawn):
    calls = Interrupted


def test_a_table_whose_calls_were_interrupted_is_made_anew():
    Interrupted.due, slave, rows = True, start(OftenInterrupted), []
    while Interrupted.due:
        try:
            rows += run(slave, 1)
        except KeyboardInterrupt:
            interrupted = len(rows)
    assert interrupted > 0
    rows += run(slave, 300)
    assert rows == expected(0, len(rows))


class Counting(Drawn):
    """Says by other numbers how many parts are to come, or not at all."""

    left: object = np.int64(3)

    def rows(self, t, h, n):
        yield self.left
        yield self.left
        return (yield from super().rows(t, h, n))


@pytest.mark.parametrize("left", [np.int64(3), np.uint8(1), None, "many"])
def test_generators_may_count_by_other_numbers_or_not_at_all(left):
    model = type("CountingOtherwise", (Counting,), {"left": left})
    assert run(start(model), 400) == expected(0, 400)
