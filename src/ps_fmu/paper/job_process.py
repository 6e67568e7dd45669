"""A process of :mod:`.jobs`: ``python -I -m ps_fmu.paper.job_process PARENT HANDLE``.

The process id of that which started it, and the handle of this one's end of a pipe to it.
"""

from __future__ import annotations

import sys
from multiprocessing.connection import Connection

from ..child_processes import end_with_parent
from .jobs import call


def main() -> int:
    """Run the jobs that come until the pipe ends."""
    parent, handle = map(int, sys.argv[1:])
    end_with_parent(parent)
    with Connection(handle) as connection:
        while serve(connection):
            pass
    return 0


def serve(connection: Connection) -> bool:
    """Run a job and send its :class:`.jobs.Answer`; False if there are no more jobs."""
    try:
        function, arguments = connection.recv()
    except EOFError:
        return False
    connection.send(call(function, arguments))
    return True


if __name__ == "__main__":
    sys.exit(main())
