"""Tables that are made in parts while the one before is in use."""

import numpy as np
import pytest
from support.states import start_stepping

from ps_fmu.slavekit.author.ahead import finish
from ps_fmu.slavekit.author.slave import ModelError, Port, Slave

H = 0.01  # s
PARTS = 5


def start(model: type[Slave], begin: float = 0.0) -> Slave:
    slave = model(instance_name="tables")
    start_stepping(slave, begin)
    return slave


def run(slave: Slave, n: int, h: float = H) -> list[list[float]]:
    rows = []
    for _ in range(n):
        assert slave.do_step(slave.time, h)
        rows.append(slave.y.tolist())
    return rows


class Parts(Slave):
    """A row is the time and the gain; a table is made in five parts, which note when they are."""

    ports = (
        Port("time", "output", "s"),
        Port("scaled", "output"),
        Port("gain", "input", start=1.0, event=True),
    )
    n_memory = 2  # gain, and whether to fail
    block_rows = 64

    def configure(self) -> None:
        self.made: list[tuple[int, int, int]] = []
        self.memory[0] = self.value("gain")

    def rows(self, t, h, n):
        times, gain = self.times(t, h, n), self.memory[0]
        for part in range(PARTS):
            if self.memory[1] and part == 2:
                raise RuntimeError("this table fails")
            self.made.append((round(t / h), part, self._core.count))
            yield PARTS - part
        return np.column_stack([times, gain * times])

    def event(self, t, h):
        self.memory[0] = self.value("gain")
        self.discard_rows()
        return False

    def restore(self) -> None:
        self.made = []


def expected(first: int, n: int, gain: float = 1.0) -> list[list[float]]:
    return [[k * H, gain * (k * H)] for k in range(first + 1, first + n + 1)]


def test_an_event_makes_the_rest_worthless():
    slave = start(Parts)
    run(slave, 110)
    slave.set_real([slave.layout.find("gain")], [3.0])
    assert run(slave, 200) == expected(110, 200, 3.0)


def test_states_do_not_hold_what_is_made_ahead():
    slave = start(Parts)
    run(slave, 121)
    kept = slave._get_fmu_state()
    content = slave._fmu_state_to_bytes(kept)
    later = run(slave, 200)
    slave._set_fmu_state(kept)
    assert run(slave, 200) == later == expected(121, 200)
    new, used = Parts(instance_name="other"), start(Parts)
    run(used, 37)
    for other in (new, used):
        other._set_fmu_state(other._fmu_state_from_bytes(content))
        assert other._fmu_state_to_bytes(other._get_fmu_state()) == content
        assert run(other, 200) == later


# --- In parts ----------------------------------------------------------------------------


@pytest.fixture
def slave() -> Slave:
    return start(Parts)


def test_the_parts_are_spread_over_the_table_before(slave):
    times = [k * H for k in range(1, 401)]
    assert run(slave, 400) == [[t, t] for t in times]
    starts = sorted({first for first, _, _ in slave.made})
    assert starts == [0, 16, 80, 144, 208, 272, 336, 400]
    for first, rows in ((80, 64), (336, 64)):
        counts = [count for start, _, count in slave.made if start == first]
        assert counts[0] == first - rows
        assert counts[-1] < first
        assert 8 <= min(np.diff(counts)) <= max(np.diff(counts)) <= 16


def test_no_step_does_more_than_one_part(slave):
    run(slave, 500)
    counts = [count for first, _, count in slave.made if first > 16]
    assert len(set(counts)) == len(counts)


def test_another_step_size_as_well(slave):
    run(slave, 100)
    assert run(slave, 70, H / 2)[-1] == pytest.approx([1.35, 1.35])
    assert run(slave, 70)[-1] == pytest.approx([2.05, 2.05])


def test_what_fails_ahead_fails_where_it_is_needed(slave):
    run(slave, 20)
    slave.memory[1] = 1.0
    run(slave, 60)  # up to the end of the table that was begun before
    before = slave._get_fmu_state().buffer.tobytes()
    for _ in range(2):
        with pytest.raises(RuntimeError, match="this table fails"):
            slave.do_step(slave.time, H)
        assert slave._get_fmu_state().buffer.tobytes() == before
    slave.memory[1] = 0.0
    assert run(slave, 2) == [[k * H, k * H] for k in (81, 82)]


def test_a_refused_step_costs_nothing(slave):
    run(slave, 90)
    with pytest.raises(Exception, match="step size"):
        slave.do_step(slave.time, -H)
    assert run(slave, 200) == [[k * H, k * H] for k in range(91, 291)]


class AtOnce(Slave):
    """A long table of the time, made by an ordinary function."""

    ports = (Port("time", "output", "s"),)
    block_rows = 2048

    def configure(self) -> None:
        self.asked: list[tuple[int, int]] = []

    def rows(self, t, h, n):
        self.asked.append((n, self._core.count))
        return self.times(t, h, n)[:, np.newaxis]


def test_long_tables_are_asked_for_in_pieces_ahead():
    slave = start(AtOnce, 0.5)
    assert run(slave, 5000) == [[0.5 + k * H] for k in range(1, 5001)]
    assert max(n for n, _ in slave.asked) == 256
    counts = [count for _, count in slave.asked if count > 80]
    assert len(set(counts)) == len(counts) > 16
    content = slave._fmu_state_to_bytes(slave._get_fmu_state())
    other = AtOnce(instance_name="other")
    other._set_fmu_state(other._fmu_state_from_bytes(content))
    assert run(other, 3000) == run(slave, 3000)


def test_rows_without_parts():
    assert finish(np.ones((2, 1))).tolist() == [[1.0], [1.0]]


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
        with pytest.raises(ModelError, match=r"t = 0\.99 s refused: Broken\.rows contains numbers that are not finite"):
            slave.do_step(slave.time, H)
        assert slave._fmu_state_to_bytes(slave._get_fmu_state()) == before


class Counting(Parts):
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
