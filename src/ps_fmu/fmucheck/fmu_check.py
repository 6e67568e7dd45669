"""All checks of one FMU file: archive, model description, other checkers, its life in two hosts."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from platform import machine

from ..cosim.archive import check_archive, check_content, read_member
from ..cosim.errors import SystemFileError
from ..cosim.xmlfile import MAXIMUM_BYTES
from . import archive_rules, lives, stages
from .reading import Description, read
from .rules import RULES, check_description

PASSED, FAILED, NOT_RUN = "passed", "FAILED", "not run"
_DESCRIPTION = "modelDescription.xml"
_FMUTOOL = "fmu_manipulation_toolbox"
_TIMEOUT = 120.0  # s


@dataclass(frozen=True)
class Row:
    """A check, how it ended, and what there is to say: for a failure one line per problem."""

    check: str
    verdict: str
    details: tuple[str, ...] = ()


def check_fmu(path: Path) -> Iterator[Row]:
    """The rows of the checks, as they are made.  Nothing is unpacked or loaded from an archive that is not safe."""
    try:
        members = check_archive(path)
        check_content(path)
        description = read(read_member(path, _DESCRIPTION, MAXIMUM_BYTES), path / _DESCRIPTION)
        problems = archive_rules.problems(path, description)
    except SystemFileError as error:
        yield Row("archive", FAILED, (str(error),))
        return
    size = f"{len(members)} files, {path.stat().st_size / 1e6:.1f} MB"
    yield Row("archive", FAILED, tuple(problems)) if problems else Row("archive", PASSED, (size,))

    version = description.root.attributes.get("fmiVersion", "")
    if not version.startswith("2."):
        yield Row("model description", NOT_RUN, (f"the rules are those of FMI 2.0, the file says {version!r}",))
    else:
        broken = tuple(map(str, check_description(description)))
        said = broken or (f"{len(RULES)} rules of FMI 2.0.4 beyond the schema",)
        yield Row("model description", FAILED if broken else PASSED, said)
    yield _fmpy_validate(path)
    yield _fmutool(path, version)
    yield from _lives(path, version, members, description)


def _fmpy_validate(path: Path) -> Row:
    from fmpy.validation import validate_fmu

    problems = validate_fmu(str(path))
    return Row("FMPy validate", FAILED if problems else PASSED, tuple(problems))


def _fmutool(path: Path, version: str) -> Row:
    name = "fmutool -check"
    if not version.startswith(("2.", "3.")):
        return Row(name, NOT_RUN, (f"it checks FMI 2.0 and 3.0, the file says {version!r}",))
    if importlib.util.find_spec(_FMUTOOL) is None:
        return Row(name, NOT_RUN, ("fmu-manipulation-toolbox is not installed",))
    command = [sys.executable, "-m", f"{_FMUTOOL}.cli.fmutool", "-input", str(path.resolve()), "-check"]
    try:
        run = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=_TIMEOUT)
    except subprocess.TimeoutExpired:
        return Row(name, FAILED, (f"did not end within {_TIMEOUT:g} s",))
    lines = (run.stdout + run.stderr).splitlines()
    errors = [line.partition("|")[2].strip() for line in lines if line.startswith(("ERROR", "CRITICAL"))]
    if run.returncode != 0 and not errors:
        errors = [f"exit code {run.returncode}", *lines[-5:]]
    return Row(name, FAILED if errors else PASSED, tuple(errors))


def _lives(path: Path, version: str, members: Sequence[str], description: Description) -> Iterator[Row]:
    from fmpy import platform, supported_platforms

    there = supported_platforms(str(path))
    interface = description.root.find("CoSimulation")
    identifier = interface.attributes.get("modelIdentifier", "") if interface is not None else ""
    reason = None
    if not version.startswith("2."):
        reason = f"FMI {version} is not run here"
    elif interface is None:
        reason = "the FMU is for model exchange"
    elif not (identifier.isascii() and identifier.isidentifier()):
        reason = f"modelIdentifier {identifier!r} is not a C identifier"
    elif platform not in there:
        reason = f"no library for {platform}, there are some for {', '.join(there) or 'no platform'}"
    if reason is not None:
        yield Row("life in FMPy", NOT_RUN, (reason,))
        yield Row("life in a C host", NOT_RUN, (reason,))
        return
    yield from _stages("FMPy", lives.in_fmpy(path))
    yield from _life_in_c_host(path, platform, members, description)


def _life_in_c_host(path: Path, platform: str, members: Sequence[str], description: Description) -> Iterator[Row]:
    """Where an FMU of ours finds no Python, once more with one named to it: that is the machine's lack, not its own."""
    host = lives.c_host(platform)
    if host is None:
        yield Row("life in a C host", NOT_RUN, (f"the host was not compiled for {platform} on {machine()}",))
        return
    try:
        found = lives.in_c_host(host, path, description, platform)
        stage, problem = found[-1]
        if stage == "instantiate" and problem and lives.looks_for_python(members):
            python = os.environ.get(lives.PYTHON_VARIABLE, sys.executable)
            told = f"once more with {lives.PYTHON_VARIABLE}={python}"
            yield Row("C host, nothing set", NOT_RUN, (told, *problem.splitlines()))
            found = lives.in_c_host(host, path, description, platform, **{lives.PYTHON_VARIABLE: python})
    except OSError as error:
        yield Row("life in a C host", NOT_RUN, (f"the host cannot be started: {error}",))
        return
    yield from _stages("C host", found)


def _stages(host: str, found: Iterable[stages.Result]) -> Iterator[Row]:
    for stage, problem in found:
        yield Row(f"{host}: {stage}", FAILED if problem else PASSED, tuple(problem.splitlines()))
