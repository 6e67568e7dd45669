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
_VERDICT = "ps_fmu trial: "  # begins a last line of output; the exit code may be the slave's own: os._exit(0)
_FINISHED, _STATE_FAILED = "finished", "state: "
_USUAL_STEP = 0.01  # s, where the model has no default experiment
_STEPS = 3


class SmokeError(RuntimeError):
    """A built FMU does not run by itself; the text ends with what it printed."""


class StateError(RuntimeError):
    """The FMU runs, but its states are not what it claims."""


def check(fmu: Path) -> None:
    """Run an FMU by itself.  Raises SmokeError if it fails, StateError if only its states do."""
    try:
        run = subprocess.run(
            [sys.executable, "-I", "-B", __file__, str(fmu)],
            capture_output=True,
            encoding="utf-8",
            errors="replace",  # the slave may print anything
            timeout=_TIMEOUT,
        )
    except subprocess.TimeoutExpired:
        raise SmokeError(f"{fmu.name} did not finish a few steps within {_TIMEOUT:g} s") from None
    output = f"{run.stdout}{run.stderr}"
    _, found, verdict = (run.stdout.splitlines() or [""])[-1].partition(_VERDICT)
    if found and verdict.startswith(_STATE_FAILED):
        raise StateError(verdict.removeprefix(_STATE_FAILED))
    if run.returncode or not found:
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
    experiment = description.defaultExperiment
    start = float((experiment is not None and experiment.startTime) or 0.0)
    step = float((experiment is not None and experiment.stepSize) or _USUAL_STEP)
    outputs = [v.valueReference for v in description.modelVariables if (v.causality, v.type) == ("output", "Real")]
    slave.instantiate()
    for reset in (False, True):
        if reset:
            slave.reset()
        slave.setupExperiment(startTime=start)
        slave.enterInitializationMode()
        slave.getReal(outputs)
        slave.exitInitializationMode()
        _step(slave, start, step)
        try:
            _compare_states(slave, description, start, step, outputs)
        except Exception as error:
            raise StateError(" ".join(f"{type(error).__name__}: {error}".split())) from error
    slave.terminate()
    slave.freeInstance()


def _compare_states(slave: Any, description: Any, start: float, step: float, outputs: list[int]) -> None:
    """Steps from a state give the same outputs again, as far as the FMU claims that."""
    if description.coSimulation.canGetAndSetFMUstate:
        _move_inputs(slave, description)
        expected = _step_from_a_state(slave, start, step, outputs)
        if _step_from_a_state(slave, start, step, outputs) != expected:
            raise AssertionError("steps from the same state give other outputs")
        serialises = description.coSimulation.canSerializeFMUstate
        if serialises and _step_from_a_state(slave, start, step, outputs, serialised=True) != expected:
            raise AssertionError("steps from a serialised state give other outputs")
    elif description.coSimulation.canSerializeFMUstate:
        raise AssertionError("canGetAndSetFMUstate is not claimed")


def _step(slave: Any, time: float, step: float) -> None:
    from fmpy.fmi1 import FMICallException
    from fmpy.fmi2 import fmi2Discard

    try:
        slave.doStep(time, step)
    except FMICallException as error:
        if error.status == fmi2Discard:
            raise AssertionError("do_step did not return True: fmi2Discard, no step was made") from None
        raise


def _move_inputs(slave: Any, description: Any) -> None:
    """Another value for each Real input, within its limits, so that what the slave keeps in silence moves."""
    for variable in description.modelVariables:
        if (variable.causality, variable.type) == ("input", "Real"):
            low, high = (float(limit) if limit is not None else None for limit in (variable.min, variable.max))
            value = float(variable.start or 0.0) + 0.1
            value = high if high is not None and value > high else value
            slave.setReal([variable.valueReference], [low if low is not None and value < low else value])


def _step_from_a_state(
    slave: Any, start: float, step: float, outputs: list[int], serialised: bool = False
) -> list[float]:
    """Outputs after some more steps; the state is then as after the first step."""
    state = slave.getFMUstate()
    if serialised:
        content = slave.serializeFMUstate(state)
        slave.freeFMUstate(state)
        state = slave.deSerializeFMUstate(content)
        slave.setFMUstate(state)
    values: list[float] = []
    for i in range(1, _STEPS):
        _step(slave, start + i * step, step)
        values += slave.getReal(outputs)
    slave.setFMUstate(state)
    slave.freeFMUstate(state)
    return values


if __name__ == "__main__":
    for absent in ("ps_fmu", "pythonfmu"):
        sys.modules[absent] = None  # type: ignore[assignment]
    try:
        exercise(Path(sys.argv[1]))
        verdict = _FINISHED
    except StateError as error:
        verdict = f"{_STATE_FAILED}{error}"
    except Exception as error:  # the FMU itself has printed the traceback, if there is one
        sys.exit(f"{type(error).__name__}: {error}")
    print(f"{_VERDICT}{verdict}")
