"""A process of :mod:`.jobs`: ``python -I -m ps_fmu.paper.job_process ADDRESS``, with the key on its input."""

from __future__ import annotations

import sys
from multiprocessing.connection import Client, Connection

from .jobs import KEY_BYTES, call


def main() -> int:
    """Run the jobs that come until the connection ends."""
    with Client(sys.argv[1], authkey=sys.stdin.buffer.read(KEY_BYTES)) as connection:
        while serve(connection):
            pass
    return 0


def serve(connection: Connection) -> bool:
    """Run a job and send (error, result), one of which is None; False if there are no more jobs."""
    try:
        function, arguments = connection.recv()
    except EOFError:
        return False
    connection.send(call(function, arguments))
    return True


if __name__ == "__main__":
    sys.exit(main())
