"""The life of an FMU in a host written in C whose environment is PATH and HOME, beside that in FMPy.

Each finds faults that the other cannot.  The C host finds FMUs that rely on libraries of a Python host, change settings
of the host, cannot be unloaded, have other start values than the model description states, or cannot move their state
to another instance.  FMPy is a Python program, which an FMU with Python inside has to share.  It steps two instances by
turns, has its own reader of the model description, and runs on platforms for which no C host was compiled.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

from ..files.archive import extract
from ..native import find_compiled, find_platform, list_platforms
from ..slavekit.pack.stages import StageResult, watch_stages
from .reading import Description, Variable, parse_number

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
    """The stages of the life in the C host, see ``native/host/host.c``; it ends at the first that no other can follow.

    ``environment``: variables besides PATH and HOME.  Raises OSError if the host cannot be started, SystemFileError if
    the FMU cannot be unpacked.
    """
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    with tempfile.TemporaryDirectory(prefix="fmu_life_") as temporary:
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
