"""What a step of a system costs in libcosim and in Ecos, each in a process of its own; they store nothing."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

from ps_fmu.cosim import System, write_ssp
from ps_fmu.cosim.description import index_variables, read_description

HOSTS = Path(__file__).resolve().parents[1] / "tests" / "system" / "hosts"
IMPORTERS = ("libcosim", "Ecos")


def in_importer(
    importer: str, system: System, step: float, steps: int, rounds: int, folder: Path
) -> tuple[list[float], Mapping[str, float]]:
    """us per step in each round, and the last values of all Real outputs by ``component.variable``.

    Raises RuntimeError if the importer fails.
    """
    archive = folder / "system.ssp"
    write_ssp(system, archive)
    wanted = {
        component.name: {
            variable.name: (variable.valueReference, variable.type)
            for variable in index_variables(read_description(component.source)).values()
            if variable.causality == "output" and variable.type == "Real"
        }
        for component in system.components
    }
    script = HOSTS / f"in_{importer.lower()}.py"
    command = [sys.executable, str(script), str(archive), json.dumps(wanted), str(steps)]
    command += [repr(step)] if importer == "Ecos" else []
    run = subprocess.run([*command, str(rounds)], capture_output=True, text=True)
    if run.returncode != 0:
        raise RuntimeError(f"{importer}: {run.stdout}{run.stderr}")
    costs, values = [line for line in run.stdout.splitlines() if line.startswith(("[", "{"))][-2:]  # FMUs print, too
    return json.loads(costs), json.loads(values)
