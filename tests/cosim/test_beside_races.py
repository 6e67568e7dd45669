"""Two threads at the rows of a run: what the loop takes away or makes again, the observers' thread does not see."""

import threading
from queue import LifoQueue

import numpy as np
import pytest

from ps_fmu.cosim import Column
from ps_fmu.cosim.clock import StepClock
from ps_fmu.cosim.recording.beside import DeliveryBeside
from ps_fmu.cosim.rows import RowLayout, Rows
from ps_fmu.cosim.structure import PortName

H = 0.01
COLUMNS = (Column("a.x", "1", "Real", ""), Column("a.n", "1", "Integer", ""))
EXPECTED = np.column_stack([np.arange(3.0), [7, 8, 9]])
CHANCE_S = 0.2
"""So long another thread has the chance to do what it must not do [s]."""


class Storing:
    """Observer that keeps what it is given."""

    def __init__(self):
        self.blocks, self.early_rows, self.came = [], [], threading.Event()

    def block(self, first_index, time, values):
        self.blocks.append(values.copy())

    def early(self, first_index, time, values):
        self.early_rows.append(values.copy())
        self.came.set()


class Interrupted(LifoQueue):
    """Ctrl-C comes while the loop waits for a free block."""

    def get(self, *args, **options):
        raise KeyboardInterrupt


def fill(rows, count=3):
    """Store rows as FMUs do, with C ints in the place of doubles."""
    for number in range(count):
        rows.real.values[0], rows.discrete.values[0] = number, 7 + number
        rows.store_latest()


@pytest.fixture
def made():
    """Rows of a Real and an Integer, 3 of 5 of them complete, an observer, and a delivery from a thread."""
    rows = Rows(RowLayout(COLUMNS, {PortName("a", "x"): 0}, {PortName("a", "n"): 0}), 5)
    storing = Storing()
    fill(rows)
    delivery = DeliveryBeside(rows, StepClock(0.0, H), COLUMNS, [storing], lambda: rows.filled)
    yield rows, storing, delivery
    delivery.close()


def test_integers_are_converted_once_when_ctrl_c_ends_the_wait_for_a_free_block(made):
    _, storing, delivery = made
    delivery._free = Interrupted()
    with pytest.raises(KeyboardInterrupt) as caught:
        delivery.hand_over()
    with pytest.raises(KeyboardInterrupt):
        delivery.conclude(caught.value)
    np.testing.assert_array_equal(np.concatenate(storing.blocks), EXPECTED)


def test_early_rows_are_copies_so_that_the_integers_of_a_block_are_converted_once(made):
    _, storing, delivery = made
    delivery._serve_early()
    delivery._serve_early()
    np.testing.assert_array_equal(storing.early_rows, [EXPECTED, EXPECTED])
    delivery.hand_over()
    delivery.wait()
    np.testing.assert_array_equal(storing.blocks, [EXPECTED])


def test_no_early_rows_are_copied_from_a_block_that_is_being_handed_over(made, monkeypatch):
    """Before it is another one, nor after that as rows that come before those of the block."""
    rows, storing, delivery = made
    go_on, others = rows.next_block, []

    def pause():
        others.append(threading.Thread(target=delivery._serve_early))
        others[0].start()
        assert not storing.came.wait(CHANCE_S)
        go_on()

    monkeypatch.setattr(rows, "next_block", pause)
    delivery.hand_over()
    others[0].join()
    delivery.wait()
    assert all(len(values) == 0 for values in storing.early_rows)
    np.testing.assert_array_equal(storing.blocks, [EXPECTED])


def test_rows_are_not_made_again_while_another_thread_counts_them(made):
    rows, storing, delivery = made
    delivery.close()
    seen, others = [], []

    def count():
        others.append(threading.Thread(target=rows.go_back, args=(1,)))
        others[0].start()
        others[0].join(CHANCE_S)
        seen.append(rows.filled)
        return rows.filled

    delivery._count_rows = count
    delivery._serve_early()
    others[0].join()
    assert seen == [3]
    assert rows.filled == 1
    np.testing.assert_array_equal(storing.early_rows[0], EXPECTED)
