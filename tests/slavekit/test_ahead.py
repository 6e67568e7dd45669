"""Tables that are made in parts while the one before is in use."""

import numpy as np
import pytest

from ps_fmu.slavekit.author.ahead import finish
from ps_fmu.slavekit.author.slave import Port, Slave

H = 0.01  # s
PARTS = 5


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


@pytest.fixture
def slave() -> Parts:
    found = Parts(instance_name="parts")
    found.setup_experiment(0.0)
    found.enter_initialization_mode()
    found.exit_initialization_mode()
    return found


def run(slave: Parts, n: int, h: float = H) -> list[list[float]]:
    rows = []
    for _ in range(n):
        assert slave.do_step(slave.time, h)
        rows.append(slave.y.tolist())
    return rows


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


def test_an_event_makes_the_rest_worthless(slave):
    run(slave, 100)
    slave.set_real([slave.layout.find("gain")], [3.0])
    assert run(slave, 100) == [[k * H, 3.0 * (k * H)] for k in range(101, 201)]


def test_another_step_size_as_well(slave):
    run(slave, 100)
    assert run(slave, 70, H / 2)[-1] == pytest.approx([1.35, 1.35])
    assert run(slave, 70)[-1] == pytest.approx([2.05, 2.05])


def test_states_do_not_hold_what_is_made_ahead(slave):
    run(slave, 121)
    content = slave._fmu_state_to_bytes(slave._get_fmu_state())
    expected = run(slave, 100)
    other = Parts(instance_name="other")
    other._set_fmu_state(other._fmu_state_from_bytes(content))
    assert other._fmu_state_to_bytes(other._get_fmu_state()) == content
    assert run(other, 100) == expected


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
    slave = AtOnce(instance_name="at once")
    slave.setup_experiment(0.5)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
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
