"""Processes that tests have started, and those that these have started: any of them may end at any moment."""

import json
import os
import subprocess
import sys
import time
from contextlib import suppress

import psutil

PATIENCE_S = 300.0
"""What nobody should wait for: a machine may be slow, and a test that waits as long has failed."""


def end_with_children(process):
    children = []
    with suppress(psutil.NoSuchProcess):
        children = psutil.Process(process.pid).children(recursive=True)
    for one in (process, *children):
        with suppress(psutil.NoSuchProcess):
            one.kill()
    process.wait()


def read_command(process):
    """The words of a process; none of one that has just ended."""
    with suppress(psutil.Error):
        return process.cmdline()
    return []


def start_dask(what, *arguments, beginning="", environment=None):
    """A ``scheduler`` or a ``worker`` of dask, as by hand; ``beginning``: what its Python does first."""
    program = f"{beginning}\nfrom distributed.cli.dask_{what} import main; main()"
    command = [sys.executable, "-I", "-c", program, "--no-dashboard", *arguments]
    return subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, env={**os.environ, **(environment or {})}
    )


def wait_for_scheduler(file):
    """The address in a scheduler's file, once it is complete."""
    found = []

    def read():
        with suppress(OSError, ValueError):
            found.append(json.loads(file.read_text())["address"])
        return found

    wait_until(read)
    return found[0]


def wait_until(condition):
    """Wait for ``condition()``."""
    end = time.monotonic() + PATIENCE_S
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)
