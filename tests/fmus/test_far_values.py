"""Values that no one would choose: the models take them, or refuse them by name; nothing else is raised."""

from dataclasses import replace

import pytest
from hypothesis import given, settings
from support.models import Host, slave_class
from support.states import clocks, numbers, use_made_up_state

from ps_fmu.slavekit.author.slave import ModelError, Refused
from ps_fmu.slavekit.author.state import to_bytes

H = 1e-4  # s


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


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@settings(max_examples=40)
@given(clocks(), numbers())
@pytest.mark.parametrize(
    "folder",
    ["feedforward_isolator", "pointing_commander", "manipulator_plant", "inertial_sensors", "voice_coils"],
)
def test_states_that_someone_made_up_are_refused_or_gone_on_from(folder, clock, changes):
    host = Host(folder).run_mode()
    host.step(H, 5)
    use_made_up_state(host.slave, clock, changes, H)


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
            assert f"far beyond what is usual: state {place - states.start} = 1e+100" in said[-1]
        slave._set_fmu_state(good)
    assert said
