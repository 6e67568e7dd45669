"""Ends of the process that libraries ask for, which are directed to the guard; each in a process of its own.

tests/cosim/test_misbehaving.py has those of an FMU in its calls.
"""

import os
import struct
import subprocess
import sys
from pathlib import Path

import pytest
from support.faulty import compile_c

SOURCE = """
#include <pthread.h>
#include <stdlib.h>
#include <threads.h>
#include <unistd.h>

static void (*at_fault)(int) = _exit;
static int calls = 1;
static void count_call(int code) { calls += code; }
int count_calls(void) { return calls += 10; }
void replace(void) { at_fault = count_call; }
void fail(int code) { at_fault(code); }
void end_thread(void) { pthread_exit(NULL); }
void end_thread_with_0(void) { thrd_exit(0); }
static void *end_own(void *unused) { pthread_exit(unused); }
int join_a_thread(void)
{
    pthread_t thread;
    return pthread_create(&thread, NULL, end_own, NULL) + pthread_join(thread, NULL);
}
static void leave_with_0(void) { _exit(0); }
static void exit_with_0(void) { exit(0); }
void leave(int code) { _exit(code); }
void leave_by_pointer(int code) { static void (*volatile function)(int) = _Exit; function(code); }
void leave_at_end(void) { atexit(leave_with_0); }
void exit_at_end(void) { atexit(exit_with_0); }
__attribute__((constructor)) static void begin(void)
{
    if (getenv("EXIT_WHILE_LOADING"))
        exit(0);
    if (getenv("REPLACE_WHILE_LOADING"))
        replace();
}
"""
OTHER = """
#include <dlfcn.h>
#include <stdlib.h>
#include <unistd.h>
void leave(int code) { _exit(code); }
__attribute__((constructor)) static void look(void)
{
    if (getenv("LIBRARY") != NULL)
        dlclose(dlopen(getenv("LIBRARY"), RTLD_NOW));
}
"""
LINKED = {"at once": ("-Wl,-z,relro,-z,now",), "lazily": ("-Wl,-z,norelro,-z,lazy",)}
HEAD = """
import ctypes, os, sys
from ps_fmu.cosim import guard
with guard.divert_ends("plant"), guard.NamedCall("plant: loading the library"):
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
        [sys.executable, "-c", HEAD + text, str(library)], capture_output=True, text=True, timeout=300, check=False,
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


@pytest.mark.parametrize("how", LINKED)
def test_a_variable_of_the_library(libraries, how):
    """It is diverted, but not if the library has given it another function."""
    text = "print(library.fail(5) or library.count_calls() - 11, file=sys.stderr)"
    assert run(libraries[how], text) == (5, "an FMU: called _exit(): the process ends\n")
    assert run(libraries[how], text, REPLACE_WHILE_LOADING="1") == (0, "5\n")


@pytest.mark.parametrize("function", ["end_thread", "end_thread_with_0"])
def test_the_thread_of_the_master_ends_the_process(libraries, function):
    """Without it nothing would go on, nor end."""
    said = "plant: fmi2Reset: ended its thread: the process ends\n"
    assert run(libraries["lazily"], f"with guard.NamedCall('plant: fmi2Reset'): library.{function}()") == (1, said)


def test_a_thread_of_the_library_ends(libraries):
    text = "with guard.NamedCall('plant: fmi2Reset'): print(library.join_a_thread(), file=sys.stderr)"
    assert run(libraries["lazily"], text) == (0, "0\n")


@pytest.fixture(scope="module")
def other(tmp_path_factory):
    """A library that looks for another one, which it closes again."""
    folder = tmp_path_factory.mktemp("other")
    source = folder / "other.c"
    source.write_text(OTHER)
    return compile_c(source, folder / "other.so", "-ldl")


@pytest.mark.parametrize("last", ["looks.so", "broken.so"])
def test_a_library_of_before_is_left_alone(libraries, other, tmp_path, last):
    """Whichever the FMU loads and closes on its way, and if it cannot be loaded."""
    for name in ("earlier.so", "looks.so"):
        (tmp_path / name).write_bytes(other.read_bytes())
    source = tmp_path / "broken.c"
    source.write_text("int nowhere(void); int leave(int); int f(void) { return nowhere() + leave(0); }\n")
    compile_c(source, tmp_path / "broken.so", "-Wl,-z,now", str(other))
    text = f"""
earlier = ctypes.CDLL({str(tmp_path / "earlier.so")!r})
os.environ["LIBRARY"] = sys.argv[1] + ".copy"
try:
    with guard.divert_ends("plant"), guard.NamedCall("plant: loading the library"):
        ctypes.CDLL({str(tmp_path / last)!r})
except OSError as error:
    print("undefined symbol" in str(error), file=sys.stderr)
earlier.leave(0)
"""
    copy = Path(f"{libraries['lazily']}.copy")
    copy.write_bytes(libraries["lazily"].read_bytes())
    assert run(libraries["lazily"], text) == (0, "True\n" if last == "broken.so" else "")


def test_variables_beside_the_closed_part_stay_open(libraries, tmp_path):
    """The loader closes whole pages; some linkers have the part to close end within one."""
    library = tmp_path / "within.so"
    library.write_bytes(_close_more(libraries["at once"].read_bytes()))
    text = "print(library.count_calls(), file=sys.stderr)\nlibrary.fail(5)"
    assert run(library, text) == (5, "11\nan FMU: called _exit(): the process ends\n")


def _close_more(content):
    """An ELF file with the read-only part 2000 B longer, which is less than a page."""
    content, kind = bytearray(content), 0x6474E552  # PT_GNU_RELRO
    begin, size, count = struct.unpack_from("<Q14xHH", content, 32)[0], *struct.unpack_from("<HH", content, 54)
    places = range(begin, begin + size * count, size)
    (place,) = [at for at in places if struct.unpack_from("<I", content, at)[0] == kind]
    address, _, _, length = struct.unpack_from("<QQQQ", content, place + 16)
    assert (address + length) % 4096 == 0
    struct.pack_into("<Q", content, place + 40, length + 2000)
    return bytes(content)
