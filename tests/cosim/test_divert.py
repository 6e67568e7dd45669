"""Ends of the process that libraries ask for, which are directed to the guard; each in a process of its own.

tests/cosim/test_misbehaving.py has those of an FMU in its calls.
"""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from support.faulty import compile_c

SOURCE = """
#include <stdlib.h>
#include <unistd.h>

static void leave_with_0(void) { _exit(0); }
static void exit_with_0(void) { exit(0); }
void leave(int code) { _exit(code); }
void leave_by_pointer(int code) { static void (*volatile function)(int) = _Exit; function(code); }
void leave_at_end(void) { atexit(leave_with_0); }
void exit_at_end(void) { atexit(exit_with_0); }
__attribute__((constructor)) static void begin(void) { if (getenv("EXIT_WHILE_LOADING")) exit(0); }
"""
LINKED = {"at once": ("-Wl,-z,relro,-z,now",), "lazily": ("-Wl,-z,norelro,-z,lazy",)}
HEAD = """
import ctypes, os, sys
from ps_fmu.cosim import guard
with guard.divert_ends(), guard.NamedCall("plant: loading the library"):
    library = ctypes.CDLL(sys.argv[1])
"""


@pytest.fixture(scope="module")
def libraries(tmp_path_factory):
    """By how their calls are linked."""
    folder = tmp_path_factory.mktemp("ends")
    source = folder / "ends.c"
    source.write_text(SOURCE)
    return {how: compile_c(source, folder / f"{how[-4:]}.so", *flags) for how, flags in LINKED.items()}


def run(library, text, **environment):
    ended = subprocess.run(
        [sys.executable, "-c", HEAD + text, str(library)], capture_output=True, text=True, timeout=60, check=False,
        cwd=Path(__file__).parents[2], env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path), **environment},
    )  # fmt: skip
    return ended.returncode, ended.stderr


@pytest.mark.parametrize("how", LINKED)
@pytest.mark.parametrize("function", ["leave", "leave_by_pointer"])
def test_no_library_ends_the_process_with_0(libraries, how, function):
    said = "an FMU: called _exit(): the process ends\n"
    assert run(libraries[how], f"library.{function}(0)") == (1, said)
    assert run(libraries[how], f"library.{function}(5)") == (5, said)


@pytest.mark.parametrize("function", ["leave_at_end", "exit_at_end"])
@pytest.mark.parametrize("code", [0, 3])
def test_a_library_does_not_change_how_the_process_ends(libraries, function, code):
    """Some leave in this way what others do at the end: the command is done, or has failed, before."""
    text = f"with guard.arm(True):\n    pass\nlibrary.{function}()\nwith guard.arm(True):\n    pass\nsys.exit({code})"
    assert run(libraries["at once"], text) == (code, "")


def test_exit_while_a_library_is_loaded(libraries):
    said = "plant: loading the library: called exit(): the process ends\n"
    assert run(libraries["at once"], "", EXIT_WHILE_LOADING="1") == (1, said)


def test_python_may_leave_outside_of_calls_only(libraries):
    assert run(libraries["at once"], "os._exit(0)") == (0, "")
    code, said = run(libraries["at once"], "with guard.NamedCall('plant: fmi2Reset'): os._exit(0)")
    assert (code, said) == (1, "plant: fmi2Reset: called _exit(): the process ends\n")


def test_a_copy_of_the_process_ends_as_it_likes(libraries):
    text = """
with guard.NamedCall("plant: fmi2Reset"):
    for end in (os._exit, library.leave):
        if (child := os.fork()) == 0:
            end(0)
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), file=sys.stderr)
"""
    assert run(libraries["lazily"], text) == (0, "0\n0\n")
