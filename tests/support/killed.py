"""``ps-fmu`` in a process that ends by SIGKILL at a chosen moment: ``killed.py KIND NUMBER ARGUMENT ...``.

``interrupt``: Ctrl-C after so many rows.
``rows``: some turns of the threads after so many rows have gone to the recorders, wherever the threads are, also
within netCDF, and at the latest when the recorder is closed; ``names``: before a file gets its name for the so-many-th
time.  Without such a moment nobody is killed.  Checkpoints are taken whenever they are due, however long they take.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import threading
import time

from ps_fmu.cli import main
from ps_fmu.cosim.recording.recorder import Recorder
from ps_fmu.runs import keeping


def kill() -> None:
    os.kill(os.getpid(), signal.SIGKILL)


def kill_after_rows(number: int) -> None:
    """Among so many rows: some turns of the threads after the block that holds the row."""
    turns = random.Random(number).randrange(3000)

    def wait_and_kill() -> None:
        for _ in range(turns):
            time.sleep(0.0)  # gives way to the other threads
        kill()

    def act() -> None:
        Recorder.close = lambda self: kill()
        threading.Thread(target=wait_and_kill, daemon=True).start()

    act_after_rows(number, act)


def act_after_rows(number: int, act) -> None:
    """At the block that holds the row."""
    original, seen = Recorder.block, 0

    def block(self, first_index, times, values):
        nonlocal seen
        before, seen = seen, seen + len(times)
        if before <= number < seen:
            act()
        original(self, first_index, times, values)

    Recorder.block = block


def interrupt_after_rows(number: int) -> None:
    """As Ctrl-C does."""
    act_after_rows(number, lambda: os.kill(os.getpid(), signal.SIGINT))


def kill_before_name(number: int) -> None:
    """Files get their names when they are complete: checkpoints, results, summary, report."""
    seen = 0

    def watch(event, arguments):
        nonlocal seen
        if event == "os.rename" and not str(arguments[1]).endswith(".pyc"):
            seen += 1
            if seen > number:
                kill()

    sys.addaudithook(watch)


if __name__ == "__main__":
    kinds = {"rows": kill_after_rows, "names": kill_before_name, "interrupt": interrupt_after_rows}
    keeping.SHARE = None
    kinds[sys.argv[1]](int(sys.argv[2]))
    sys.exit(main(sys.argv[3:]))
