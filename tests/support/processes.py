"""Processes that tests have started, and those that these have started: any of them may end at any moment."""

from contextlib import suppress

import psutil


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
