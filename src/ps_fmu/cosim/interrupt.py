"""Ctrl-C between two steps instead of inside an FMU.

An FMU written in Python runs in the same interpreter: KeyboardInterrupt would be raised inside its step,
where it is taken for a fault of the model or lost.  So the signal is only noted, and the loop ends after
the step.
"""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import c_int
from types import FrameType


@contextmanager
def note_interrupts() -> Iterator[c_int]:
    """A number that is zero until SIGINT arrives; the loop in C can read it, too.

    A second SIGINT acts at once, by the handler from before, for an FMU in Python, or in a process of its own, that
    hangs.  Nothing is changed outside of the main thread, where Python takes no signals, and where SIGINT is ignored.
    """
    noted = c_int()
    previous = signal.getsignal(signal.SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not main or previous in (None, signal.SIG_IGN):
        yield noted
        return

    def note(number: int, frame: FrameType | None) -> None:
        if noted:
            signal.signal(signal.SIGINT, previous)
            if callable(previous):
                previous(number, frame)
        noted.value = number

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, previous)
