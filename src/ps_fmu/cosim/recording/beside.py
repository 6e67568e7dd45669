"""Observers in a thread beside the loop: while FMUs step, those of the block before are recorded and evaluated.

FMUs, and numpy and netCDF on whole blocks, do not hold the interpreter's lock.  The observers see the same blocks in
the same order as without the thread, so that results are the same to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from queue import Empty, LifoQueue, SimpleQueue
from threading import Event, Thread
from typing import NamedTuple

from ..clock import StepClock
from ..rows import Array, Column, Rows
from .delivery import Delivery, EarlyObserver, Observer, count_finite

WAITING_BLOCKS = 7
"""That wait for the observers at most, while one more is filled: writing a chunk of the file takes as long as five."""
EARLY_S = 1.0
"""Rows of an unfinished block are stored, too, when no block has come for so long [s]."""


class _Handed(NamedTuple):
    """A block on its way to the observers."""

    first_index: int
    rows: Array
    """As the loop has left them: the thread makes numbers of them."""
    block: Array


class DeliveryBeside(Delivery):
    """As :class:`Delivery`, from a thread.

    A failure of an observer is raised when the next block is handed over; what was computed meanwhile is dropped, so
    that all observers end with the block in which one failed.
    """

    def __init__(
        self,
        rows: Rows,
        clock: StepClock,
        columns: Sequence[Column],
        observers: Sequence[Observer],
        count_rows: Callable[[], int],
    ) -> None:
        super().__init__(rows, clock, columns, observers, count_rows)
        self._early = [observer for observer in observers if isinstance(observer, EarlyObserver)]
        self._failure: BaseException | None = None
        self._next = rows.first_index  # the row that the observers expect
        # The block that was freed last comes first: it is still in the cache.
        self._free: LifoQueue[Array] = LifoQueue()
        for block in rows.make_blocks(WAITING_BLOCKS):
            self._free.put(block)
        self._handed: SimpleQueue[_Handed | Event | Callable[[], None] | None] = SimpleQueue()
        self._thread: Thread | None = Thread(target=self._work, name="observers", daemon=True)
        self._thread.start()

    def hand_over(self) -> None:
        """Hand the complete rows to the thread.  Raises what an observer raised in an earlier block."""
        self._raise_failure()
        free = self._free.get()  # first: Ctrl-C may end the wait, and rows are completed once
        first = self.rows.first_index
        self._handed.put(_Handed(first, *self.rows.exchange(free)))

    def call(self, function: Callable[[], None]) -> None:
        """As :meth:`Delivery.call`, in the thread; not after an observer has failed."""
        self._handed.put(function)

    def wait(self) -> None:
        """Return when the observers have all that was handed over.  Raises what one of them raised."""
        done = Event()
        self._handed.put(done)
        done.wait()
        self._raise_failure()

    def conclude(self, error: BaseException) -> None:
        """As :meth:`Delivery.conclude`; what an observer raised in an earlier block is the reason, if there is one."""
        self.close()
        self._raise_failure()
        super().conclude(error)

    def close(self) -> None:
        """End the thread when the observers have all that was handed over."""
        thread, self._thread = self._thread, None
        if thread is not None:
            self._handed.put(None)
            thread.join()

    def _raise_failure(self) -> None:
        if self._failure is not None:
            raise self._failure from self._failure.__cause__

    def _work(self) -> None:
        while True:
            try:
                item = self._handed.get(timeout=EARLY_S)
            except Empty:
                self._serve_early()
                continue
            if item is None:
                return
            if isinstance(item, Event):
                item.set()
                continue
            if isinstance(item, _Handed):
                if self._failure is None:
                    self._serve_block(item)
                self._free.put(item.block)
            elif self._failure is None:
                try:
                    item()
                except BaseException as error:
                    self._note(error)

    def _serve_block(self, item: _Handed) -> None:
        self._next = item.first_index + len(item.rows)
        try:
            failure = self.serve(item.first_index, *self.rows.finish(item.rows))
        except BaseException as error:  # no memory, say: the loop must not wait for ever
            failure = error
        self._note(failure)

    def _serve_early(self) -> None:
        """Give rows of the unfinished block to those who store them: an FMU may be slow, or hang."""
        if self._failure is not None or not self._early:
            return
        try:
            with self.rows.lock:  # no rows are handed over or made again meanwhile
                values = self.rows.copy(self._count_rows())
                if self.rows.first_index != self._next:
                    return  # the block has been handed over
            values = values[: count_finite(values)]
            time = self._clock.times(self._next, len(values))
            for observer in self._early:
                observer.early(self._next, time, values)
        except BaseException as raised:
            raised.add_note("Raised while rows of an unfinished block were stored.")
            self._note(raised)

    def _note(self, failure: BaseException | None) -> None:
        if failure is not None:
            self._failure, self.failed_at = failure, max(self._next - 1, 0)


def make_delivery(
    rows: Rows,
    clock: StepClock,
    columns: Sequence[Column],
    observers: Sequence[Observer],
    count_rows: Callable[[], int],
    beside: bool,
) -> Delivery:
    """One in the thread of the loop, or ``beside`` it; ``count_rows`` counts the rows of the block at any time."""
    return (DeliveryBeside if beside else Delivery)(rows, clock, columns, observers, count_rows)
