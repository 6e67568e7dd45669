"""Values, steps and times that no one would choose: models take them, or refuse them by name; hosts live on."""

import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from support.host import unpack
from support.models import Host, slave_class
from support.states import clocks, numbers, use_made_up_state

from ps_fmu.slavekit.author.slave import ModelError, Refused
from ps_fmu.slavekit.author.state import to_bytes

H = 1e-4  # s
ALL: dict[str, Any] = {"wheel_1__enabled": True, "tone_1__force__x": 1.0, "chirp__force__x": 1.0}


def outcome(model, reference, value, before):
    """What is said about a value that is set before or after initialisation; "" if nothing."""
    slave = model(instance_name="far")
    try:
        if before:
            slave.set_real([reference], [value])
        slave.setup_experiment(0.0)
        slave.enter_initialization_mode()
        slave.exit_initialization_mode()
        if not before:
            slave.set_real([reference], [value])
        for k in range(3):
            slave.do_step(k * H, H)
    except (ModelError, Refused) as error:
        return str(error)
    return ""


@pytest.mark.filterwarnings("error::RuntimeWarning")  # numpy's would tell a user nothing
@pytest.mark.parametrize(
    ("folder", "every"),
    [
        ("feedforward_isolator", 1),
        ("pointing_commander", 1),
        ("manipulator_plant", 2),
        ("disturbance_source", 7),
        ("inertial_sensors", 9),
        ("voice_coils", 1),
    ],
)
@pytest.mark.parametrize("value", [1e300, 1e30, -1e12, 1e-300])
def test_each_of_them(folder, every, value):
    model = slave_class(folder)
    reals = [(vr, p) for vr, p in model.layout.by_reference.items() if p.type == "Real" and p.causality != "output"]
    said = []
    for reference, port in reals[::every]:
        for before in (True, False) if port.causality == "input" else (True,):
            text = outcome(model, reference, value, before)
            said.append(text)
            vector = port.name.rpartition(".")[0] or port.name  # parameters speak of payload.com, not of .x
            assert text == "" or vector in text, (port.name, text)
    assert any(said)


MADE_UP = dict.fromkeys(
    ("feedforward_isolator", "pointing_commander", "manipulator_plant", "inertial_sensors", "voice_coils"), ({}, H)
) | {"disturbance_source": ({"noise__period": 20.0, **ALL}, 100 * H)}
"""FMU -> start values, and the step [s] after the state was set."""


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(max_examples=40)
@given(clocks(), numbers())
@pytest.mark.parametrize("folder", MADE_UP)
def test_states_that_someone_made_up_are_refused_or_gone_on_from(folder, clock, changes):
    start, h = MADE_UP[folder]
    host = Host(folder, **start).run_mode()
    host.step(H, 5)
    use_made_up_state(host.slave, clock, changes, h)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_states_far_from_the_usual_are_refused_in_words():
    """An event of the plant is the first that has to do with them; the text names the one that someone made up."""
    host = Host("manipulator_plant").run_mode()
    host.step(H, 5)
    slave, said = host.slave, []
    good, states = slave._get_fmu_state(), slave.layout.x
    for place in range(states.start, states.stop):
        buffer = good.buffer.copy()
        buffer[place] = 1e100
        made_up = replace(good, buffer=buffer, clock=replace(good.clock, pending=True))
        try:
            slave._set_fmu_state(slave._fmu_state_from_bytes(to_bytes(made_up)))
            slave.do_step(slave.time, H)
        except (ModelError, Refused) as error:
            said.append(str(error))
            assert f"far beyond what is usual: {slave.layout.describe(place)} = 1e+100" in said[-1]
        slave._set_fmu_state(good)
    assert said


@pytest.mark.filterwarnings("error::RuntimeWarning")
@pytest.mark.parametrize("h", [0.3, 7.0, 1e6])
def test_long_steps_give_the_same_noise(h: float) -> None:
    slave = Host("disturbance_source", **ALL).run_mode().slave
    times = np.arange(1, 26) * h
    rows = np.empty((25, 6))
    for k in range(25):
        slave.do_step(slave.time, h)
        rows[k] = slave.y
    np.testing.assert_array_equal(rows, slave.disturbance(times))


@pytest.mark.parametrize("h", [1e10, 1e100, 1e300])
def test_a_step_beyond_all_time_is_refused(h: float) -> None:
    slave = Host("disturbance_source", **ALL).run_mode().slave
    before = to_bytes(slave._get_fmu_state())
    text = re.escape(f"{h:g} s after the start of the experiment: expected at most 1e+09 s")
    with pytest.raises((Refused, ModelError), match=text):
        slave.do_step(0.0, h)
    assert to_bytes(slave._get_fmu_state()) == before
    slave.do_step(0.0, 1e-4)


@pytest.mark.parametrize(
    ("start", "h", "text"),
    [
        (1e300, 1e-4, "leads from .* to a later time"),
        (1e300, 1e290, "after the start"),
        (-1e300, 1e300, "after the start"),
    ],
)
def test_a_start_beyond_all_time(start: float, h: float, text: str) -> None:
    slave = slave_class("disturbance_source")(instance_name="far")
    slave.setup_experiment(start)
    slave.enter_initialization_mode()
    slave.exit_initialization_mode()
    with pytest.raises((Refused, ModelError), match=text):
        slave.do_step(start, h)


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
