"""Does a built FMU stand alone?  Loads and runs it where neither ps_fmu nor pythonfmu can be imported.

:func:`check` starts this very file as a script in a fresh interpreter; it must not import anything of the
package.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

_TIMEOUT = 120.0  # s


class SmokeError(RuntimeError):
    """A built FMU does not run by itself; the text ends with what it printed."""


def check(fmu: Path) -> None:
    """Run an FMU by itself.  Raises SmokeError if it fails."""
    try:
        run = subprocess.run(
            [sys.executable, "-I", "-B", __file__, str(fmu)], capture_output=True, text=True, timeout=_TIMEOUT
        )
    except subprocess.TimeoutExpired:
        raise SmokeError(f"{fmu.name} did not finish a few steps within {_TIMEOUT:g} s") from None
    if run.returncode != 0:
        output = f"{run.stdout}{run.stderr}"
        raise SmokeError(f"{fmu.name} does not run by itself (exit code {run.returncode}):\n{output}")


def exercise(fmu: Path) -> None:
    """Twice, from two folders of which the first is gone when the second is used: the life of an instance."""
    for _ in range(2):
        folder = tempfile.mkdtemp(prefix="smoke_")
        try:
            _run_once(fmu, folder)
        finally:
            shutil.rmtree(folder, ignore_errors=True)


def _run_once(fmu: Path, folder: str) -> None:
    from fmpy import extract, read_model_description
    from fmpy.fmi2 import FMU2Slave

    extract(str(fmu), unzipdir=folder)
    description = read_model_description(folder)
    slave = FMU2Slave(
        guid=description.guid,
        unzipDirectory=folder,
        modelIdentifier=description.coSimulation.modelIdentifier,
        instanceName="smoke",
    )
    reals = [v for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
    outputs = [v.valueReference for v in reals]
    step = float(description.defaultExperiment.stepSize)
    slave.instantiate(loggingOn=True)
    for reset in (False, True):
        if reset:
            slave.reset()
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        slave.getReal(outputs)
        slave.exitInitializationMode()
        slave.doStep(0.0, step)
        expected = _step_from_a_state(slave, step, outputs)
        if _step_from_a_state(slave, step, outputs, serialised=True) != expected:
            raise AssertionError("a step from a serialised state gives other outputs")
    slave.terminate()
    slave.freeInstance()


def _step_from_a_state(slave: Any, step: float, outputs: list[int], serialised: bool = False) -> list[float]:
    """Outputs after the second step; the state is then as after the first one."""
    state = slave.getFMUstate()
    if serialised:
        content = slave.serializeFMUstate(state)
        slave.freeFMUstate(state)
        state = slave.deSerializeFMUstate(content)
        slave.setFMUstate(state)
    slave.doStep(step, step)
    values: list[float] = slave.getReal(outputs)
    slave.setFMUstate(state)
    slave.freeFMUstate(state)
    return values


if __name__ == "__main__":
    for absent in ("ps_fmu", "pythonfmu"):
        sys.modules[absent] = None  # type: ignore[assignment]
    exercise(Path(sys.argv[1]))
