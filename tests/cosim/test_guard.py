"""The end of a process within a call of an FMU: last words, rows that are kept, exit code.

tests/cosim/test_misbehaving.py has more kinds of ends.
"""

import os
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from support import faulty
from support.cosim import ssd_text

RUN = """
import sys
from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.recording.recorder import Recorder
path, fmus, results = sys.argv[1:]
with Master(read_system(path, fmus), 0.01) as master:
    master.initialise()
    with Recorder(results, columns=master.columns, step=master.step, run="run") as recorder:
        master.run(0.1, [recorder])
print("not reached")
"""
HEAD = """
import ctypes, os, threading
from ps_fmu.cosim.guard import NamedCall
"""
LAST = ": the process ends; --isolate gives FMUs processes of their own\n"


def start(text, *arguments):
    return subprocess.run(
        [sys.executable, "-c", text, *map(str, arguments)], capture_output=True, text=True, timeout=240, check=False,
        cwd=Path(__file__).parents[2], env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    return faulty.build(tmp_path_factory.mktemp("faulty")).parent


@pytest.mark.parametrize(
    ("fault", "end", "code"), [("segfault", "crashed with SIGSEGV", -11), ("exit_0", "called exit(0)", 1)]
)
def test_rows_before_are_in_the_file(fmus, tmp_path, fault, end, code):
    (tmp_path / "test.ssd").write_text(ssd_text({"other": "Faulty", fault: "Faulty"}, [f"other.y -> {fault}.u"]))
    ended = start(RUN, tmp_path / "test.ssd", fmus, tmp_path / "results.nc")
    assert (ended.returncode, ended.stdout, ended.stderr) == (
        code,
        "",
        f"{fault}: fmi2DoStep at t = 0.05 s {end}{LAST}the rows up to t = 0.05 s are stored\n",
    )
    with netCDF4.Dataset(tmp_path / "results.nc") as file:
        time, y = (np.array(file["run"][name][:]) for name in ("time", f"{fault}.y"))
    np.testing.assert_allclose(time, 0.01 * np.arange(6), atol=1e-12)
    np.testing.assert_allclose(y[1:], 0.01 * np.arange(1, 6) + 0.01 * np.arange(5), atol=1e-12)


def test_places_of_threads_and_of_calls_in_calls():
    """Those that were left are not named: exit() then ends the process as it likes."""
    ended = start(f"""{HEAD}
left = threading.Event()
def call():
    with NamedCall("second: fmi2GetReal"):
        left.wait(300)
thread = threading.Thread(target=call)
with NamedCall("first: fmi2GetReal"):
    thread.start()
    with NamedCall("nested: fmi2SetReal"):
        pass
left.set()
thread.join()
ctypes.CDLL(None).exit(0)
""")
    assert (ended.returncode, ended.stderr) == (0, "")


@pytest.mark.parametrize(("code", "expected"), [(0, 1), (7, 7)])
def test_exit_in_a_thread_names_its_own_call(code, expected):
    ended = start(f"""{HEAD}
def call():
    with NamedCall("second: fmi2GetReal"):
        ctypes.CDLL(None).exit({code})
with NamedCall("first: fmi2GetReal"):
    with NamedCall("nested: fmi2SetReal"):
        pass
    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
""")
    assert (ended.returncode, ended.stderr) == (expected, f"second: fmi2GetReal called exit({code}){LAST}")


def test_python_ends_as_it_likes_beside_a_call():
    ended = start(f"""{HEAD}
entered = threading.Event()
def call():
    with NamedCall("first: fmi2DoStep"):
        entered.set()
        threading.Event().wait()
threading.Thread(target=call, daemon=True).start()
entered.wait(300)
""")
    assert (ended.returncode, ended.stderr) == (0, "")


def test_crashes_beside_calls_are_not_those_of_fmus():
    ended = start(f"""{HEAD}
with NamedCall("first: fmi2GetReal"):
    pass
os.kill(os.getpid(), 11)
""")
    assert (ended.returncode, ended.stderr) == (-11, "")


def test_an_overflow_of_the_stack_in_any_thread():
    ended = start(f"""{HEAD}
class Stack(ctypes.Structure):
    _fields_ = [("sp", ctypes.c_void_p), ("flags", ctypes.c_int), ("size", ctypes.c_size_t)]
found = []
def call():
    with NamedCall("fmi2GetReal"):
        stack = Stack()
        ctypes.CDLL(None).sigaltstack(None, ctypes.byref(stack))
        found.append((stack.sp, stack.flags))
call()
thread = threading.Thread(target=call)
thread.start()
thread.join()
(first, _), (second, _) = found
print(first is not None and second is not None and first != second, [flags for _, flags in found])
""")
    assert ended.stdout == "True [0, 0]\n", ended.stderr


def test_a_copy_of_the_process_that_is_made_in_a_call():
    """It ends with its own code, without a word, and stores nothing."""
    ended = start(f"""{HEAD}
with NamedCall("first: fmi2GetReal"):
    if (child := os.fork()) == 0:
        ctypes.CDLL(None).exit(0)
    print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
""")
    assert (ended.returncode, ended.stdout, ended.stderr) == (0, "0\n", "")
