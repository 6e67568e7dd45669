"""All checks of one FMU file: archive, model description, other checkers, its life in two hosts."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from ..cosim.archive import check_archive, check_content, read_member
from ..cosim.errors import SystemFileError
from ..cosim.xmlfile import MAXIMUM_BYTES
from ..native import find_platform
from ..slavekit.pack.stages import StageResult, live_in_fmpy
from . import archive_rules, lives, other_checkers
from .reading import Description, read_description
from .rules import DESCRIPTION_RULES, check_description
from .verdicts import FAILED, NOT_RUN, OK, WARNING, CheckResult

_DESCRIPTION = "modelDescription.xml"


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
        problems = archive_rules.find_problems(path, description)
    except SystemFileError as error:
        yield CheckResult("archive", FAILED, (str(error),))
        return
    size = f"{len(members)} files, {path.stat().st_size / 1e6:.1f} MB"
    yield CheckResult("archive", FAILED if problems else OK, tuple(problems) or (size,))

    version = description.root.attributes.get("fmiVersion", "")
    yield _check_rules(description, version)
    yield other_checkers.run_fmpy(path)
    yield other_checkers.run_fmutool(path, version)
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
