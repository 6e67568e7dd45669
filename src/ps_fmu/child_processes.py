"""What every Python process has in common that is a command or is started by one: its environment, and its end."""

from __future__ import annotations

import gc
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress

ONE_THREAD = {
    name: "1" for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "VECLIB_MAXIMUM_THREADS")
}
"""The matrices are small: threads in BLAS cost more than they bring, and others need the processors."""
PARENT_CHECK_S = 1.0
NEW_OBJECTS = 100_000
"""More new objects than this, less those that are freed, start the garbage collector; four of our FMUs make 35,000."""


def use_one_thread() -> None:
    """Have BLAS work in one thread, if numpy is imported later and the user has not said otherwise.

    A thread of BLAS that waits for work takes the processor from the FMUs or from what stores their rows.  OpenMP is
    left alone: other people's FMUs may work with it.
    """
    for name, value in ONE_THREAD.items():
        if name != "OMP_NUM_THREADS":
            os.environ.setdefault(name, value)


@contextmanager
def collect_rarely() -> Iterator[None]:
    """Start the garbage collector rarely: what a start makes remains, and collections cost a twentieth of its time."""
    often, *rarely = gc.get_threshold()
    if often:
        gc.set_threshold(max(often, NEW_OBJECTS), *rarely)
    try:
        yield
    finally:
        gc.set_threshold(often, *rarely)


def end_with_parent(parent: int | None = None) -> None:
    """End this process when that which started it is gone, also in the middle of its work.

    ``parent``: its process id, if it may have ended already; by default that of now.  The steps of FMUs do not hold
    Python's lock, so this thread runs beside them.
    """
    parent = parent or os.getppid()

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(PARENT_CHECK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def end_group(process: int) -> None:
    """Kill a process that was started in a session of its own, by its id, and the processes that it has started."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process, signal.SIGKILL)


def describe_end(code: int) -> str:
    """How a process ended, from its return code: the exit code, or the name of the signal."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"signal {signal.Signals(-code).name}"
    except ValueError:
        return f"signal {-code}"
