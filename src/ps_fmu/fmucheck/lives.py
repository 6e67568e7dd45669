"""Two lives of an FMU: in FMPy, and in a host written in C that finds nothing set around it.

Each finds what the other cannot.  The C host shows FMUs that need what a Python host has loaded already, that change
what belongs to the host, that cannot be unloaded, whose inputs start elsewhere than the model description says, or
whose state cannot move to another instance.  FMPy is a Python program, which an FMU with Python inside has to share; it
steps two instances by turns; it reads the model description by itself, and runs on platforms that no C host was
compiled for.
"""

from __future__ import annotations

import math
import os
import re
import shutil
import sys
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path
from platform import machine

from ..cosim.archive import extract
from . import life_cycle
from .host.compile import HOST
from .reading import Description, Variable, number
from .stages import Result, watch

PYTHON_VARIABLE = "PS_FMU_PYTHON"
"""Names a Python to the launcher of FMUs that were built here."""
_DEFAULT_STEP = 1e-2  # s
_REFERENCE = re.compile(r"[0-9]{1,10}")


def in_fmpy(fmu: Path) -> list[Result]:
    """The stages of the life in FMPy, see :mod:`.life_cycle`; after the first that failed there are no more."""
    with tempfile.TemporaryDirectory(prefix="fmu_life_") as folder:
        report = Path(folder, "report")
        command = [sys.executable, "-I", "-B", life_cycle.__file__, str(fmu.resolve()), folder, str(report)]
        return watch(command, report)


def c_host(platform: str) -> Path | None:
    """The C host for this machine and a platform of FMI; None if it was not compiled for them."""
    return HOST.path(platform) if machine().lower() in ("x86_64", "amd64") else None


def in_c_host(host: Path, fmu: Path, description: Description, platform: str, **environment: str) -> list[Result]:
    """The stages of the life in the C host, see ``host/host.c``; after one that no other can follow there are no more.

    The environment is PATH, HOME and what is given here.  Raises OSError if the host cannot be started.
    """
    kept = {name: os.environ[name] for name in ("PATH", "HOME") if name in os.environ}
    with tempfile.TemporaryDirectory(prefix="fmu_life_") as temporary:
        folder = Path(temporary)
        extract(fmu, folder / "fmu")
        plan, report, program = folder / "plan", folder / "report", folder / "host"
        plan.write_text("\n".join(_plan(folder / "fmu", description, platform)) + "\n", encoding="utf-8")
        shutil.copyfile(host, program)  # an installed file need not be executable
        program.chmod(0o700)
        return watch([str(program), str(plan), str(report)], report, kept | environment)


def looks_for_python(members: Iterable[str]) -> bool:
    """Has the FMU a launcher of ours, which has to find a Python?"""
    return "resources/launcher.txt" in members


def _plan(folder: Path, description: Description, platform: str) -> Iterator[str]:
    """The lines of ``host/plan.h`` for an unpacked FMU; numbers that make no sense are left out."""
    interface = description.root.find("CoSimulation")
    if interface is None:
        raise ValueError("the FMU is not for co-simulation")
    given = interface.attributes
    (folder / "resources").mkdir(exist_ok=True)
    resources = (folder / "resources").as_uri().removeprefix("file://")
    yield f"library {folder / 'binaries' / platform / given.get('modelIdentifier', '')}.so"
    yield f"guid {_one_line(description.root.attributes.get('guid', ''))}"
    yield f"resources {resources}"
    yield f"start {_setting(description, 'startTime', 0.0)!r}"
    yield f"step {_setting(description, 'stepSize', 0.0) or _DEFAULT_STEP!r}"
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
            yield f"output {kind} {variable.reference} {_one_line(variable.name)}"
        elif variable.causality == "input" and _has_value(variable):
            yield f"input {kind} {variable.reference} {variable.start}"


def _setting(description: Description, name: str, default: float) -> float:
    experiment = description.root.find("DefaultExperiment")
    value = number(experiment.attributes.get(name, ""), "Real") if experiment is not None else math.nan
    return value if math.isfinite(value) and value >= 0.0 else default


def _has_value(variable: Variable) -> bool:
    """Is the start value one that can be set, and told in a line?"""
    if variable.start is None or variable.start != _one_line(variable.start):
        return False
    return variable.type in ("Boolean", "String") or math.isfinite(number(variable.start, variable.type))


def _one_line(text: str) -> str:
    return " ".join(text.splitlines())
