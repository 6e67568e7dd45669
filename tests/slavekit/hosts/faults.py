"""A host that makes mistakes: every entry point, N times each, in one process; then a correct run.

Usage: faults.py FMU N.  Prints the growth of resident memory over the second half of the mistakes, kB, and the
position after the correct run, m.
"""

import math
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from fmpy import extract, read_model_description
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import FMU2Slave

ERROR = 3  # fmi2Error


def resident() -> int:
    """Resident memory, kB."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * 4


def expect_error(call: Callable[[], object]) -> None:
    try:
        call()
    except FMICallException as error:
        assert error.status == ERROR, error
    else:
        raise AssertionError("a mistake was answered OK")


def main(fmu: str, n: int) -> None:
    folder = tempfile.mkdtemp()
    extract(fmu, unzipdir=folder)
    description = read_model_description(folder)
    vr = {v.name: v.valueReference for v in description.modelVariables}
    slave, other = (
        FMU2Slave(
            guid=description.guid,
            unzipDirectory=folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        for name in ("one", "other")
    )
    for instance in (slave, other):
        instance.instantiate(loggingOn=instance is slave)
    slave.setupExperiment(startTime=0.0)
    slave.enterInitializationMode()
    slave.setString([vr["note"]], ["impossible"])
    before = [
        slave.exitInitializationMode,
        lambda: slave.getReal([vr["position"]]),
        slave.terminate,
        slave.enterInitializationMode,
    ]
    for call in before * n:
        expect_error(call)
    slave.setString([vr["note"]], ["possible"])
    slave.exitInitializationMode()
    slave.setReal([vr["reference"]], [2.0])  # makes the event before the next step fail
    mistakes = [
        lambda: slave.getReal([999]),
        lambda: slave.getInteger([vr["mass"]]),
        lambda: slave.getBoolean([vr["mass"]]),
        lambda: slave.getString([vr["mass"]]),
        lambda: slave.setReal([vr["load"], vr["force"]], [1.0, math.nan]),
        lambda: slave.setReal([vr["position"]], [1.0]),
        lambda: slave.setReal([vr["mass"]], [3.0]),
        lambda: slave.setInteger([vr["substeps"]], [3]),
        lambda: slave.setBoolean([vr["engaged"]], [1]),
        lambda: slave.setString([vr["note"]], ["100 %n %s"]),
        lambda: slave.doStep(0.0, 0.1),
        lambda: slave.doStep(0.0, 0.0),
        lambda: slave.doStep(5.0, 0.1),
        lambda: slave.setupExperiment(startTime=0.0),
        slave.enterInitializationMode,
        slave.exitInitializationMode,
        lambda: slave.deSerializeFMUstate(b"hostile"),
    ]
    for call in mistakes * (n // 2):
        expect_error(call)
    half = resident()
    for call in mistakes * (n - n // 2):
        expect_error(call)
    growth = resident() - half

    slave.setReal([vr["reference"]], [0.5])
    for i in range(10):
        slave.doStep(i * 0.1, 0.1)
    position = slave.getReal([vr["position"]])[0]
    slave.terminate()
    slave.reset()
    for instance in (slave, other):
        instance.freeInstance()
    print(growth, repr(position))


if __name__ == "__main__":
    main(sys.argv[1], int(sys.argv[2]))
