"""A host has overflows and invalid operations end the process: no FMU does that, and the host's settings stay."""

import subprocess
import sys
from pathlib import Path

import pytest
from support.host import unpack

HOST = """
import ctypes, sys
import numpy as np
from fmpy import read_model_description
from fmpy.fmi2 import FMU2Slave

folder, steps = sys.argv[1], [float(h) for h in sys.argv[2:]]
description = read_model_description(folder)
libm = ctypes.CDLL("libm.so.6")
INVALID, DIVISION, OVERFLOW = 0x01, 0x04, 0x08
WANTED = INVALID | DIVISION | OVERFLOW
identifier = description.coSimulation.modelIdentifier
fmu = FMU2Slave(guid=description.guid, unzipDirectory=folder, modelIdentifier=identifier, instanceName="fmu")
outputs = [v.valueReference for v in description.modelVariables if v.causality == "output" and v.type == "Real"]
inputs = [v.valueReference for v in description.modelVariables if v.causality == "input" and v.type == "Real"]

def trapped(call, *arguments, **named):
    libm.feenableexcept(WANTED)
    try:
        return call(*arguments, **named)
    finally:
        left = libm.fegetexcept()
        libm.fedisableexcept(WANTED)
        assert left == WANTED, left

found = []
for arming in (trapped, lambda call, *arguments, **named: call(*arguments, **named)):
    arming(fmu.instantiate)
    arming(fmu.setupExperiment, startTime=0.0)
    arming(fmu.enterInitializationMode)
    arming(fmu.exitInitializationMode)
    time = 0.0
    values = []
    for n, h in enumerate(steps):
        for value in (float("nan"), 5e-324 * (n % 3)):
            try:
                arming(fmu.setReal, inputs, [value] * len(inputs))
            except Exception as error:
                print("refused", value)
        values.append(arming(fmu.getReal, inputs))
        try:
            arming(fmu.doStep, currentCommunicationPoint=time, communicationStepSize=h)
        except Exception as error:
            print("refused", h)
        else:
            time += h
        values.append(arming(fmu.getReal, outputs))
    state = arming(fmu.getFMUState)
    arming(fmu.setFMUState, state)
    arming(fmu.freeFMUState, state)
    fmu.fmi2FreeInstance(fmu.component)
    found.append(values)
assert found[0] == found[1]
print("alive", len(found[0]))
"""


@pytest.mark.parametrize("model", ["DisturbanceSource", "ManipulatorPlant", "FeedforwardIsolator"])
def test_a_host_with_traps_lives_and_keeps_them(built_fmus: Path, tmp_path: Path, model: str) -> None:
    """The same bits with traps and without; a step of 1e300 s overflows in each of them, and NaN is no input."""
    folder = unpack(built_fmus / f"{model}.fmu", tmp_path / model)
    steps = ["1e-4"] * 40 + ["1e300", "1e150", "1e-4"]
    run = subprocess.run(
        [sys.executable, "-I", "-c", HOST, str(folder), *steps], capture_output=True, text=True, timeout=120
    )
    assert run.returncode == 0, run.stderr[-2000:]
    assert run.stdout.splitlines()[-1] == "alive 86"
    has_inputs = model != "DisturbanceSource"
    assert run.stdout.count("refused nan") == 86 * has_inputs
