"""Checkers of other makers, each in a process with a time limit.  They read an FMU and run nothing of it."""

from __future__ import annotations

import importlib.util
import subprocess
import sys
from pathlib import Path

from .verdicts import FAILED, NOT_RUN, OK, CheckResult

TIME_LIMIT = 120.0  # s
FMUTOOL = "fmu_manipulation_toolbox"
"""The package of fmutool."""
_FMPY = """
import sys
from fmpy.validation import validate_fmu
for problem in validate_fmu(sys.argv[1]):
    print("ERROR |", " ".join(problem.split()))
"""


def run_fmpy(fmu: Path) -> CheckResult:
    """FMPy's validation of the model description."""
    return _run("FMPy validate", "-c", _FMPY, str(fmu.resolve()))


def run_fmutool(fmu: Path, version: str) -> CheckResult:
    """``fmutool -check``, where it is installed and knows this version of FMI."""
    name = "fmutool -check"
    if not version.startswith(("2.", "3.")):
        return CheckResult(name, NOT_RUN, (f"it checks FMI 2.0 and 3.0, the file says {version!r}",))
    if importlib.util.find_spec(FMUTOOL) is None:
        return CheckResult(name, NOT_RUN, ("fmu-manipulation-toolbox is not installed",))
    return _run(name, "-m", f"{FMUTOOL}.cli.fmutool", "-input", str(fmu.resolve()), "-check")


def _run(name: str, *arguments: str) -> CheckResult:
    """Run a checker that writes its problems as ``ERROR | text``."""
    # -I: the user's current directory may hold anything, also modules with the names that the checker imports.
    command = [sys.executable, "-I", "-X", "utf8", *arguments]
    try:
        run = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace", timeout=TIME_LIMIT)
    except subprocess.TimeoutExpired:
        return CheckResult(name, FAILED, (f"did not end within {TIME_LIMIT:g} s",))
    lines = (run.stdout + run.stderr).splitlines()
    errors = [line.partition("|")[2].strip() for line in lines if line.startswith(("ERROR", "CRITICAL"))]
    if run.returncode != 0 and not errors:
        errors = [f"exit code {run.returncode}", *lines[-5:]]
    return CheckResult(name, FAILED if errors else OK, tuple(errors))
