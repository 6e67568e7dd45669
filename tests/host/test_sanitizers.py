"""The launcher's source under checks of memory and undefined behaviour (gcc or clang as cc)."""

import subprocess

import pytest
from support.host import told

# Python itself never frees all.  Where a mistake is found, the process ends with another exit code.
SETTINGS = {"ASAN_OPTIONS": "detect_leaks=0:exitcode=99", "UBSAN_OPTIONS": "print_stacktrace=1:exitcode=99"}


@pytest.mark.parametrize(("mode", "n"), [("run", 50), ("reload", 5), ("threads", 20), ("keep", 5), ("faults", 50)])
def test_the_ways_of_hosts(sanitized, mode, n):
    program, folder = sanitized
    command = [str(program), mode, str(n), str(told(folder))]
    run = subprocess.run(command, env=SETTINGS, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr[-5000:]


def test_no_python_to_be_found(sanitized):
    program, folder = sanitized
    command = [str(program), "run", "1", str(told(folder))]
    run = subprocess.run(
        command, env=SETTINGS | {"PS_FMU_PYTHON": "/bin/false"}, capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 3, run.stderr[-5000:]
