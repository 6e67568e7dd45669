"""The guard of steps in several threads, and of a run inside of a run; each in a process of its own."""

import os
import signal
import subprocess
import sys
from pathlib import Path

HEAD = """
import ctypes, os, signal, sys, threading
from ps_fmu.cosim import guard
signal.signal(signal.SIGINT, signal.default_int_handler)
library = guard.find_library()

class Thread(threading.Thread):
    # Armed until its end is asked for.
    def __init__(self):
        super().__init__()
        self.ready, self.go = threading.Event(), threading.Event()
        self.start()
        assert self.ready.wait(300)
    def run(self):
        with guard.arm(False):
            self.ready.set()
            assert self.go.wait(300)
    def end(self):
        self.go.set()
        self.join()
"""


def run(text):
    return subprocess.run(
        [sys.executable, "-c", HEAD + text], capture_output=True, text=True, timeout=240, check=False,
        cwd=Path(__file__).parents[2], env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
    )  # fmt: skip


def test_interrupts_of_a_run_are_forgotten_with_its_end():
    ended = run("""
count = ctypes.c_int.from_address(guard.find_interrupts())
seen = []
with guard.arm(True):
    for _ in range(2):
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            seen.append(count.value)
print(seen, count.value)
""")
    assert ended.stdout == "[1, 2] 0\n", ended.stderr


def test_ctrl_c_is_taken_though_another_thread_is_armed():
    ended = run("""
other = Thread()
with guard.arm(True):
    try:
        os.kill(os.getpid(), signal.SIGINT)
        print(ctypes.c_int.in_dll(library, "guard_interrupts").value)
    except KeyboardInterrupt:
        print(ctypes.c_int.in_dll(library, "guard_interrupts").value)
other.end()
""")
    assert ended.stdout.split()[-1:] == ["1"], ended.stderr


def test_ctrl_c_is_given_back_though_another_thread_stays_armed():
    ended = run("""
with guard.arm(True):
    other = Thread()
signal.signal(signal.SIGINT, signal.default_int_handler)  # as note_interrupts does
print(library.guard_restore())
other.end()
""")
    assert ended.stdout.split() == ["0"], ended.stderr


STEPS = """
TYPE = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
from ps_fmu.cosim.compiled import _Loop, _Operation
import numpy as np
def run(function):
    # One step of one FMU whose fmi2DoStep is this address.
    operation = (_Operation * 1)(_Operation(4, 0, None, None, None, None, function))
    end, times, rows = guard.End(), np.zeros(1), np.zeros(1)
    loop = _Loop(operation, 1, rows.ctypes.data, 0, 1.0)
    status = library.run_guarded(
        ctypes.byref(loop), ctypes.c_void_p(rows.ctypes.data), ctypes.c_void_p(times.ctypes.data),
        ctypes.c_int64(1), ctypes.c_double(10.0), ctypes.byref(ctypes.c_int()), None, ctypes.byref(end))
    return status, end.ending, end.number
CRASH = ctypes.cast(ctypes.CDLL(None).abort, ctypes.c_void_p).value
"""


def test_a_run_inside_of_a_step_leaves_the_outer_one_its_way_out():
    ended = run(f"""{STEPS}
from ctypes import PYFUNCTYPE
inner = []
@TYPE
def step(*_):
    inner.append(run(CRASH))
    # The rest of the step crashes, too, once Python's lock is given back.
    ctypes.CDLL(None).abort()
with guard.arm(False):
    found = run(ctypes.cast(step, ctypes.c_void_p).value)
os.write(1, repr((inner, found)).encode())
os._exit(0)
""")
    assert ended.stdout == f"([(4, 1, {int(signal.SIGABRT)})], (4, 1, {int(signal.SIGABRT)}))", ended.stderr


def test_an_overflow_of_the_stack_in_a_thread_that_is_armed_second():
    ended = run("""
class Stack(ctypes.Structure):
    _fields_ = [("sp", ctypes.c_void_p), ("flags", ctypes.c_int), ("size", ctypes.c_size_t)]
other = Thread()
before, within = Stack(), Stack()
ask = lambda found: ctypes.CDLL(None).sigaltstack(None, ctypes.byref(found))
ask(before)
with guard.arm(False):
    ask(within)
print(within.sp is not None and within.sp != before.sp)
other.end()
""")
    assert ended.stdout.split() == ["True"], ended.stderr


def test_names_of_calls_in_two_threads_do_not_stay():
    """Entered and left in turn: a process that ends well afterwards says nothing."""
    ended = run("""
class Caller(Thread):
    def run(self):
        with guard.NamedCall("second: fmi2GetReal"):
            self.ready.set()
            assert self.go.wait(300)
with guard.NamedCall("first: fmi2GetReal"):
    caller = Caller()
caller.end()
""")
    assert (ended.returncode, ended.stderr) == (0, "")


def test_exit_in_a_thread_names_its_own_call():
    ended = run("""
exit_process = ctypes.CDLL(None).exit
class Caller(Thread):
    def run(self):
        with guard.NamedCall("second: fmi2GetReal"):
            self.ready.set()
            assert self.go.wait(300)
            exit_process(0)
with guard.NamedCall("first: fmi2GetReal"):
    caller = Caller()
    with guard.NamedCall("nested: fmi2SetReal"):
        pass
    caller.end()
""")
    assert ended.returncode == 1
    assert ended.stderr == "second: fmi2GetReal: called exit(): the process ends\n"
