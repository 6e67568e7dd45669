"""How often checkpoints are taken: no more often than the time of a run can pay for."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from time import perf_counter

from ..errors import UsageError

LEAST = 0.25
"""Part of the share that is for checkpoints in any case, where the rows in journals take more than the rest."""
LOOK_S = 0.1
"""A checkpoint that waits is looked at again after so long [s]: to stop at a communication point costs some 50 us."""


class Pace:
    """Tells when the last checkpoint has been paid for.

    All is measured as time that passes, not as processor time: where other programs have the processor both last
    longer, a disk that is slow counts, and a run that waits for FMUs in processes of their own has checkpoints all the
    same.  Rows that go into journals count as well.

    Parameters
    ----------
    share: of the time since a checkpoint that it may have taken, before the next; None: any
    clock: reads a time [s]

    Raises :class:`UsageError` for a share that is none.
    """

    def __init__(self, share: float | None, clock: Callable[[], float] = perf_counter) -> None:
        if share is not None and not share > 0.0:
            raise UsageError(f"checkpoint: expected a share of the time above 0, got {share!r}")
        self._share, self._clock = share, clock
        self._first_index, self._first_s = 0, clock()
        self._begun_s = -math.inf
        self._rows_s = 0.0
        self._cost_s = 0.0
        self._is_written = True

    def start(self, index: int) -> None:
        """The run begins, at a communication point."""
        self._first_index, self._first_s = index, self._clock()

    def is_paid(self, rows_s: float) -> bool:
        """Whether a checkpoint may be taken now; the rows have taken ``rows_s`` since the start of the run [s]."""
        if self._share is None:
            return True
        if not self._is_written:
            return False
        earned = self._share * (self._clock() - self._begun_s)
        return self._cost_s <= max(earned - (rows_s - self._rows_s), LEAST * earned)

    def begin(self, rows_s: float) -> None:
        """A checkpoint is begun."""
        self._begun_s, self._rows_s = self._clock(), rows_s
        self._cost_s, self._is_written = 0.0, False

    @contextmanager
    def count(self) -> Iterator[None]:
        """Count the time of the body, a part of the checkpoint."""
        began = self._clock()
        try:
            yield
        finally:
            self._cost_s += self._clock() - began

    def end(self) -> None:
        """The checkpoint is written, or there will be none."""
        self._is_written = True

    def find_next_look(self, index: int) -> int:
        """The communication point at which to look again, as fast as the run has been."""
        passed = self._clock() - self._first_s
        steps = (index - self._first_index) * LOOK_S / passed if passed > 0.0 else 0.0
        return index + max(1, math.ceil(steps))
