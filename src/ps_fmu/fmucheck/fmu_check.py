"""All checks of one FMU file: archive, model description, other checkers, its life in two hosts."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ..cosim.errors import SystemFileError
from ..files.archive import check_archive, check_content, read_member
from ..files.xmlfile import MAXIMUM_BYTES
from ..native import find_platform
from ..slavekit.pack.stages import StageResult, live_in_fmpy
from . import lives, structure_rules
from .reading import Description, read_description
from .rules import DESCRIPTION_RULES, check_description
from .verdicts import FAILED, NOT_RUN, OK, WARNING, CheckResult

_DESCRIPTION = "modelDescription.xml"
TIME_LIMIT = 120.0  # s
FMUTOOL = "fmu_manipulation_toolbox"
"""The package of fmutool."""
_FMPY = """
import sys
from fmpy.validation import validate_fmu
for problem in validate_fmu(sys.argv[1]):
    print("ERROR |", " ".join(problem.split()))
"""


def check_fmu(path: Path, run: bool = True) -> Iterator[CheckResult]:
    """The results of the checks, each as soon as it is there.

    An archive that is not safe to unpack ends the checks.

    Parameters
    ----------
    path: the FMU.
    run: True: load the FMU's library and run its code, which can do all that the user can.  False: read its files only.
    """
    try:
        members = check_archive(path)
        check_content(path)
        description = read_description(read_member(path, _DESCRIPTION, MAXIMUM_BYTES), path / _DESCRIPTION)
        problems = structure_rules.find_archive_problems(path, description)
    except SystemFileError as error:
        yield CheckResult("archive", FAILED, (str(error),))
        return
    size = f"{len(members)} files, {path.stat().st_size / 1e6:.1f} MB"
    yield CheckResult("archive", FAILED if problems else OK, tuple(problems) or (size,))

    version = description.root.attributes.get("fmiVersion", "")
    yield _check_rules(description, version)
    yield _run_fmpy(path)
    yield _run_fmutool(path, version)
    reason = _find_obstacle(path, description, version) if run else "--no-run: the FMU is not loaded"
    if reason is not None:
        yield CheckResult("life in FMPy", NOT_RUN, (reason,))
        yield CheckResult("life in a C host", NOT_RUN, (reason,))
        return
    yield from _list_stages("FMPy", live_in_fmpy(path, "whole"))
    yield from _live_in_c_host(path, members, description)


def _check_rules(description: Description, version: str) -> CheckResult:
    name = "model description"
    if not version.startswith("2."):
        return CheckResult(name, NOT_RUN, (f"the rules are those of FMI 2.0, the file says {version!r}",))
    problems = check_description(description)
    errors = [str(problem) for problem in problems if problem.rule.verdict == FAILED]
    warnings = [f"warning: {problem}" for problem in problems if problem.rule.verdict == WARNING]
    if not problems:
        return CheckResult(name, OK, (f"{len(DESCRIPTION_RULES)} rules of FMI 2.0.4 beyond the schema",))
    return CheckResult(name, FAILED if errors else WARNING, (*errors, *warnings))


def _find_obstacle(path: Path, description: Description, version: str) -> str | None:
    """Why the FMU cannot be run here; None if it can."""
    from fmpy import platform, supported_platforms

    interface = description.root.find("CoSimulation")
    identifier = interface.attributes.get("modelIdentifier", "") if interface is not None else ""
    if not version.startswith("2."):
        return f"FMI {version} is not run here"
    if interface is None:
        return "the FMU is for model exchange"
    if not (identifier.isascii() and identifier.isidentifier()):
        return f"modelIdentifier {identifier!r} is not a C identifier"
    platforms = supported_platforms(str(path))
    if platform not in platforms:
        return f"no library for {platform}, there are some for {', '.join(platforms) or 'no platform'}"
    return None


def _live_in_c_host(path: Path, members: Sequence[str], description: Description) -> Iterator[CheckResult]:
    """The life in the C host.  Where an FMU of ours finds no Python, it gets one named and lives once more."""
    try:
        host = lives.find_c_host()
        if host is None:
            reason = f"the host was not compiled for {find_platform()}"
            yield CheckResult("life in a C host", NOT_RUN, (reason,))
            return
        results = lives.live_in_c_host(host, path, description)
        stage, problem = results[-1]
        if stage == "instantiate" and problem and lives.has_launcher(members):
            python = os.environ.get(lives.PYTHON_VARIABLE, sys.executable)
            note = f"once more with {lives.PYTHON_VARIABLE}={python}"
            yield CheckResult("C host, nothing set", NOT_RUN, (note, *problem.splitlines()))
            results = lives.live_in_c_host(host, path, description, **{lives.PYTHON_VARIABLE: python})
    except (OSError, SystemFileError) as error:
        yield CheckResult("life in a C host", NOT_RUN, (f"the host cannot be started: {error}",))
        return
    yield from _list_stages("C host", results)


def _list_stages(host: str, results: Iterable[StageResult]) -> Iterator[CheckResult]:
    for stage, problem in results:
        yield CheckResult(f"{host}: {stage}", FAILED if problem else OK, tuple(problem.splitlines()))


# --- Checkers of other makers: each in a process with a time limit; they read an FMU and run nothing of it ------------


def _run_fmpy(fmu: Path) -> CheckResult:
    """FMPy's validation of the model description."""
    return _run_checker("FMPy validate", "-c", _FMPY, str(fmu.resolve()))


def _run_fmutool(fmu: Path, version: str) -> CheckResult:
    """``fmutool -check``, where it is installed and knows this version of FMI."""
    name = "fmutool -check"
    if not version.startswith(("2.", "3.")):
        return CheckResult(name, NOT_RUN, (f"it checks FMI 2.0 and 3.0, the file says {version!r}",))
    if importlib.util.find_spec(FMUTOOL) is None:
        return CheckResult(name, NOT_RUN, ("fmu-manipulation-toolbox is not installed",))
    return _run_checker(name, "-m", f"{FMUTOOL}.cli.fmutool", "-input", str(fmu.resolve()), "-check")


def _run_checker(name: str, *arguments: str) -> CheckResult:
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
