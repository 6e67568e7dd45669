"""Threads of the host, where the host is a Python program."""

from __future__ import annotations

import os
import threading


def forget_host_thread() -> None:
    """Let Python end although a thread of the host, not the main one, was the first to import ``threading``.

    Python 3.11 and 3.12 take such a thread for the main one and wait at exit until it has ended, which libcosim's
    do after that only.  Newer ones have no such list.
    """
    main = threading.main_thread()
    waited_for = getattr(threading, "_shutdown_locks", None)
    if waited_for is not None and main.native_id != os.getpid():
        waited_for.discard(getattr(main, "_tstate_lock", None))
