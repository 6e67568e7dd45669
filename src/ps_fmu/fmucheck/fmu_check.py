"""All checks of one FMU file: archive, model description, other checkers, test runs in two hosts."""

from __future__ import annotations

import importlib.util
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ..cosim.errors import SystemFileError
from ..files.archive import check_archive, check_content, extract, read_member
from ..files.xmlfile import MAXIMUM_BYTES
from ..native import find_compiled, find_platform, list_platforms
from ..slavekit.pack.stages import StageResult, live_in_fmpy, watch_stages
from . import structure_rules
from .reading import Description, Variable, parse_number, read_description
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
        yield CheckResult("test run in FMPy", NOT_RUN, (reason,))
        yield CheckResult("test run in a C host", NOT_RUN, (reason,))
        return
    yield from _list_stages("FMPy", live_in_fmpy(path, "whole"))
    yield from _live_in_c_host(path, members, description)


def _check_rules(description: Description, version: str) -> CheckResult:
    name = "model description"
    if not version.startswith("2."):
        return CheckResult(name, NOT_RUN, (f"the rules are those of FMI 2.0, the file states {version!r}",))
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
        return f"no library for {platform}, only for {', '.join(platforms) or 'no platform'}"
    return None


def _live_in_c_host(path: Path, members: Sequence[str], description: Description) -> Iterator[CheckResult]:
    """The test run in the C host, repeated with a named Python if an FMU of ps_fmu finds none."""
    try:
        host = find_c_host()
        if host is None:
            reason = f"the host was not compiled for {find_platform()}"
            yield CheckResult("test run in a C host", NOT_RUN, (reason,))
            return
        results = live_in_c_host(host, path, description)
        stage, problem = results[-1]
        if stage == "instantiate" and problem and has_launcher(members):
            python = os.environ.get(PYTHON_VARIABLE, sys.executable)
            note = f"once more with {PYTHON_VARIABLE}={python}"
            yield CheckResult("C host, nothing set", NOT_RUN, (note, *problem.splitlines()))
            results = live_in_c_host(host, path, description, **{PYTHON_VARIABLE: python})
    except (OSError, SystemFileError) as error:
        yield CheckResult("test run in a C host", NOT_RUN, (f"the host cannot be started: {error}",))
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
        return CheckResult(name, NOT_RUN, (f"it checks FMI 2.0 and 3.0, the file states {version!r}",))
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


# --- The test run in a host written in C, whose environment is PATH and HOME ------------------------------------------
#
# It and FMPy each find faults that the other cannot.  The C host finds FMUs that rely on libraries of a Python host,
# change settings of the host, cannot be unloaded, have other start values than the model description states, or cannot
# move their state to another instance.  FMPy is a Python program, which an FMU with Python inside has to share.  It
# steps two instances by turns, has its own reader of the model description, and runs where no C host was compiled.

PYTHON_VARIABLE = "PS_FMU_PYTHON"
"""The environment variable that names a Python to our launcher."""
_DEFAULT_STEP = 1e-2  # s
_REFERENCE = re.compile(r"[0-9]{1,10}")


def find_c_host() -> Path | None:
    """The C host for this machine; None if it was not compiled for it.

    Raises OSError if it is damaged or missing.
    """
    return find_compiled("host") if find_platform() in list_platforms("host") else None


def live_in_c_host(host: Path, fmu: Path, description: Description, **environment: str) -> list[StageResult]:
    """The stages of the run in the C host, see ``native/host/host.c``; it ends at the first that no other can follow.

    ``environment``: variables besides PATH and HOME.  Raises OSError if the host cannot be started, SystemFileError if
    the FMU cannot be unpacked.
    """
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    with tempfile.TemporaryDirectory(prefix="fmu_test_run_") as temporary:
        folder = Path(temporary)
        extract(fmu, folder / "fmu")
        task, report, program = folder / "task", folder / "report", folder / "host"
        task.write_text("\n".join(_write_task(folder / "fmu", description)) + "\n", encoding="utf-8")
        shutil.copyfile(host, program)  # an installed file need not be executable
        program.chmod(0o700)
        return watch_stages([str(program), str(task), str(report)], report, kept | environment)


def has_launcher(members: Iterable[str]) -> bool:
    """Whether the FMU has our launcher, which needs a Python."""
    return "resources/launcher.txt" in members


def _write_task(folder: Path, description: Description) -> Iterator[str]:
    """The lines of ``host/task.h`` for an unpacked FMU; without variables whose numbers cannot be used."""
    interface = description.root.find("CoSimulation")
    if interface is None:
        raise ValueError("the FMU is not for co-simulation")
    given = interface.attributes
    (folder / "resources").mkdir(exist_ok=True)
    resources = (folder / "resources").as_uri().removeprefix("file://")
    yield f"library {folder / 'binaries' / find_platform() / given.get('modelIdentifier', '')}.so"
    yield f"guid {_join_lines(description.root.attributes.get('guid', ''))}"
    yield f"resources {resources}"
    yield f"start {_read_setting(description, 'startTime', 0.0)!r}"
    yield f"step {_read_setting(description, 'stepSize', 0.0) or _DEFAULT_STEP!r}"
    flags = {"canBeInstantiatedOnlyOncePerProcess": "once", "canGetAndSetFMUstate": "state"}
    flags["canSerializeFMUstate"] = "serialise"
    for attribute, key in flags.items():
        if given.get(attribute) in ("true", "1"):
            yield key
    for variable in description.variables:
        kind = "Integer" if variable.type == "Enumeration" else variable.type
        if not kind or not _REFERENCE.fullmatch(variable.reference) or int(variable.reference) >= 2**32:
            continue
        if variable.causality == "output":
            yield f"output {kind} {variable.reference} {_join_lines(variable.name)}"
        elif variable.causality == "input" and _can_be_set(variable):
            yield f"input {kind} {variable.reference} {variable.start}"


def _read_setting(description: Description, name: str, default: float) -> float:
    experiment = description.root.find("DefaultExperiment")
    value = parse_number(experiment.attributes.get(name, ""), "Real") if experiment is not None else math.nan
    return value if math.isfinite(value) and value >= 0.0 else default


def _can_be_set(variable: Variable) -> bool:
    """Whether the start value is a value of the variable's type and fits into a line of the task."""
    if variable.start is None or variable.start != _join_lines(variable.start):
        return False
    return variable.type in ("Boolean", "String") or math.isfinite(parse_number(variable.start, variable.type))


def _join_lines(text: str) -> str:
    return " ".join(text.splitlines())
