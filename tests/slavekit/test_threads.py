"""Ends of Python hosts that instantiate FMUs in threads of their own."""

import subprocess
import sys

HOST = """
import _thread, sys

sys.modules.pop("threading", None)
done, never = _thread.allocate_lock(), _thread.allocate_lock()
done.acquire(), never.acquire()

def worker():
    from ps_fmu.slavekit.author.slave import _forget_host_thread as forget_host_thread
    forget_host_thread()
    done.release()
    never.acquire()

_thread.start_new_thread(worker, ())
done.acquire()
import threading
print(threading.main_thread().ident == _thread.get_ident())
"""


def test_python_ends_though_a_worker_imported_threading_first():
    """The worker waits for ever, as those of thread pools do until the host has freed them."""
    run = subprocess.run([sys.executable, "-c", HOST], capture_output=True, text=True, timeout=300)
    assert (run.returncode, run.stderr) == (0, "")
    assert run.stdout == ("True\n" if sys.version_info >= (3, 13) else "False\n")
