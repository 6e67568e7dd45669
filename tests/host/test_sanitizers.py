"""The launcher's source under checks of memory, undefined behaviour and data races (gcc or clang as cc)."""

import subprocess

import pytest
from support.host import told

# Python itself never frees all.  Where a mistake is found, the process ends with another exit code.
SETTINGS = {
    "ASAN_OPTIONS": "detect_leaks=0:exitcode=99",
    "UBSAN_OPTIONS": "print_stacktrace=1:exitcode=99",
    "TSAN_OPTIONS": "exitcode=99",
}
MEMORY = "address,undefined"


def run(sanitized, sanitizers, mode, n, **environment):
    program, folder = sanitized(sanitizers)
    command = [str(program), mode, str(n), str(told(folder))]
    return subprocess.run(command, env=SETTINGS | environment, capture_output=True, text=True, timeout=300)


@pytest.mark.parametrize(("mode", "n"), [("run", 50), ("reload", 5), ("threads", 20), ("keep", 5), ("faults", 50)])
def test_the_ways_of_hosts(sanitized, mode, n):
    result = run(sanitized, MEMORY, mode, n)
    assert result.returncode == 0, result.stderr[-5000:]


@pytest.mark.parametrize(("mode", "n"), [("threads", 200), ("leave", 1)])
def test_threads_of_hosts(sanitized, mode, n):
    result = run(sanitized, "thread", mode, n)
    if "unexpected memory mapping" in result.stderr:
        pytest.skip("the thread sanitizer does not run on this kernel: sysctl vm.mmap_rnd_bits=28")
    assert result.returncode == 0, result.stderr[-5000:]


def test_no_python_to_be_found(sanitized):
    result = run(sanitized, MEMORY, "run", 1, PS_FMU_PYTHON="/bin/false")
    assert result.returncode == 3, result.stderr[-5000:]
