"""Hand complete rows to the observers, and stop at values that are not finite."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from .clock import StepClock
from .errors import SlaveError
from .rows import Array, Column, Rows


class Observer(Protocol):
    """Takes the rows of a run, block by block."""

    def block(self, first_index: int, time: Array, values: Array) -> None:
        """Take the next rows: ``time`` (rows,) [s] and ``values`` (rows, columns).

        ``first_index`` counts rows from 0, the state after initialisation.  The arrays are valid during this
        call only: copy what is to be kept.
        """


def deliver(
    rows: Rows,
    clock: StepClock,
    columns: Sequence[Column],
    observers: Sequence[Observer],
    error: BaseException | None = None,
) -> None:
    """Give the complete rows to all observers, up to the first row with a value that is not finite.

    Every observer is served even if another one raises.  Then raises, the first that applies:
    :class:`SlaveError` for a value that is not finite, with ``error`` as its consequence; ``error``, the
    reason why the run ends; what an observer raised.
    """
    values = rows.complete()
    first, time = rows.first_index, clock.times(rows.first_index, len(values))
    finite = np.isfinite(values)
    usable = len(values) if finite.all() else int(np.argmin(finite.all(axis=1)))
    failure: BaseException | None = error
    if usable < len(values):
        failure = _make_error(columns, values[usable], float(time[usable]))
        failure.__cause__ = error
    for observer in observers if usable else ():
        try:
            observer.block(first, time[:usable], values[:usable])
        except BaseException as raised:
            raised.add_note(f"Raised by the observer {type(observer).__name__}.")
            if failure is None:
                failure = raised
            else:
                failure.add_note(f"The observer {type(observer).__name__} failed, too: {raised}")
    rows.next_block()
    if failure is not None:
        raise failure


def _make_error(columns: Sequence[Column], row: Array, time: float) -> SlaveError:
    wrong = [column for column, value in zip(columns, row, strict=True) if not np.isfinite(value)]
    bad = [column.name for column in wrong]
    named = ", ".join(bad[:5]) + (f" and {len(bad) - 5} more" if len(bad) > 5 else "")
    component = wrong[0].component or bad[0].partition(".")[0]
    return SlaveError(
        f"{component}: not a finite number at t = {time:.9g} s: {named}; the rows before are kept",
        component=component,
        function="fmi2GetReal",
        status=None,
        time=time,
        variables=bad,
    )
