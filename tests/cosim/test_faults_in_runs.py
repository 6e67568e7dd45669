"""Faults and the rest of a run: neutral ones, steps that are repeated, processes, refusals, what is said of them."""

import json
import math
from itertools import count

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from support import faulty
from support.claims import verify_claim
from support.faults import run_oscillator, write

from ps_fmu.cosim import Master, SlaveError, SystemFileError
from ps_fmu.cosim.clock import StepClock
from ps_fmu.cosim.compiled import CompiledLoop
from ps_fmu.cosim.description import read_descriptions
from ps_fmu.cosim.faults.active import make_faults
from ps_fmu.cosim.faults.reading import read_faults
from ps_fmu.cosim.fmu_instance import FmuInstance
from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.plan import Plan
from ps_fmu.cosim.rows import Rows, make_layout
from ps_fmu.cosim.schemes.scheme import Scheme
from ps_fmu.cosim.structure import PortName

ACTIONS = st.one_of(
    st.builds(lambda: {"action": "bias", "value": 0.0}),
    st.builds(lambda: {"action": "scale", "value": 1.0}),
    st.builds(lambda: {"action": "delay", "value": 0.0}),
    st.builds(lambda: {"action": "noise", "rms": 0.0}),
    st.builds(lambda: {"action": "dropout", "probability": 0.0}),
)
SIGNALS = [("mass", "position"), ("mass", "velocity"), ("spring", "force"), ("spring", "velocity"), ("mass", "force")]


@given(
    st.lists(
        st.tuples(st.integers(0, 29), st.integers(1, 20), st.sampled_from(SIGNALS), ACTIONS, st.booleans()), max_size=6
    ),
    st.sampled_from(["jacobi", "gauss-seidel"]),
)
@settings(max_examples=25, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_neutral_faults_leave_every_bit(oscillator, tmp_path, events, scheme):
    """A bias of 0, a scale of 1, a delay of 0, noise of 0, a dropout that never happens."""
    entries = [
        {"time": begin * 0.01, "duration": length * 0.01, "model": model, "variable": name, "joins": joins, **action}
        for begin, length, (model, name), action, joins in events
    ]
    plain = run_oscillator(oscillator, None, scheme, 0.3)
    rows = run_oscillator(oscillator, write(tmp_path, *entries), scheme, 0.3)
    for name, values in plain.items():
        assert values.tobytes() == rows[name].tobytes(), name


@pytest.mark.parametrize(
    ("event", "text"),
    [
        ({"model": "maas"}, "model: there is no component 'maas' in the system; did you mean mass"),
        ({"variable": "positoin"}, "there is no variable 'positoin' in the FMU ToyMass; did you mean position"),
        ({"target": "mass.force"}, "is not connected to mass.force; it is connected to spring.position"),
        ({"model": "spring", "variable": "stiffness"}, "is a fixed parameter: set it before initialisation"),
        ({"model": "mass", "variable": "mass", "target": "mass.force"}, "expected none, as mass.mass is not an output"),
        ({"value": "1"}, "expected a finite number"),
        ({"action": "override", "value": "x"}, "expected a value of type Real, got 'x'"),
        ({"action": "override", "value": True}, "expected a value of type Real"),
        ({"action": "delay", "value": 0.015}, "expected a delay of whole steps of 0.01 s"),
        ({"action": "delay", "value": 1e6}, "10000000 at most"),
        ({"time": 0.1055, "duration": 0.001}, "no step of 0.01 s ends within 0.001 s: expected more"),
    ],
)
def test_what_the_system_cannot_do_is_refused_with_its_line(oscillator, tmp_path, event, text):
    path = tmp_path / "faults.json"
    whole = {"time": 0.1, "model": "mass", "variable": "position", "action": "bias", "value": 1.0, **event}
    path.write_text('{"events": [\n\n' + json.dumps(whole) + "]}")
    with pytest.raises(SystemFileError) as caught:
        Master(oscillator, 0.01, faults=read_faults(path))
    assert f"{path}: events[0]: " in str(caught.value)
    assert text in str(caught.value)


def test_a_fault_behind_the_end_of_the_run_is_refused(oscillator, tmp_path):
    faults = write(tmp_path, {"time": 2.0, "model": "mass", "variable": "position", "action": "freeze"})
    with Master(oscillator, 0.01, faults=faults) as master:
        with pytest.raises(SystemFileError, match=r"events\[0\]: time: expected a time before the end of the run, 1"):
            master.faults.check_end(1.0)
        master.faults.check_end(2.01)


def test_noises_without_seeds_are_independent(oscillator, tmp_path):
    """Two of RMS 1 on one signal have the RMS sqrt(2), and not 2; a dropout beside them changes neither."""
    noise = {"time": 0.0, "model": "mass", "variable": "position", "action": "noise", "rms": 1.0, "joins": True}
    faults = write(tmp_path, noise, noise, {**noise, "seed": 7})
    assert [event.seed for event in faults.events] == [0, 1, 7]
    rows = run_oscillator(oscillator, write(tmp_path, noise, noise), duration=20.0)
    added = rows["spring.position"] - rows["mass.position"]
    assert np.sqrt((added**2).mean()) == pytest.approx(math.sqrt(2.0), rel=0.05)


@pytest.fixture(scope="module")
def discarding(tmp_path_factory):
    """A folder with an FMU that is named after what it does wrong."""
    return faulty.build(tmp_path_factory.mktemp("faulty")).parent


def test_steps_in_parts_see_the_fault_of_the_whole_step(discarding, make_system, tmp_path):
    """The FMU ``partial`` discards all steps of 0.01 s from 0.05 s on, which are repeated in three parts."""
    found = {}
    for name in ("good", "partial"):
        system = make_system({"other": "Faulty", name: "Faulty"}, [f"other.y -> {name}.u"], discarding)
        signal = {"time": 0.02, "model": "other", "variable": "y", "joins": True}
        faults = write(
            tmp_path, {**signal, "action": "delay", "value": 0.03}, {**signal, "action": "noise", "rms": 0.5, "seed": 2}
        )
        found[name] = run_oscillator(system, faults, duration=0.1)[f"{name}.u"]
    assert found["partial"] == pytest.approx(found["good"], rel=1e-12)


@pytest.mark.parametrize("refused", range(2, 10))
def test_a_step_in_parts_is_right_or_fails(discarding, make_system, monkeypatch, refused):
    """Whenever an FMU first refuses its state: no step goes on from where another one was discarded."""
    system = make_system({"other": "Faulty", "partial": "Faulty"}, ["other.y -> partial.u"], discarding)
    expected = run_oscillator(system, duration=0.06)
    asked, keep = count(), FmuInstance.try_state
    monkeypatch.setattr(FmuInstance, "try_state", lambda self: keep(self) if next(asked) < refused else None)
    try:
        rows = run_oscillator(system, duration=0.06)
    except SlaveError as error:
        assert "has refused fmi2GetFMUstate" in "".join([str(error), *error.__notes__])
    else:
        for name, values in expected.items():
            assert values.tobytes() == rows[name].tobytes(), name
    assert next(asked) > refused


def test_isolated_fmus_see_the_same_faults(oscillator, tmp_path):
    signal = {"time": 0.1, "model": "spring", "variable": "position"}
    mass = {"time": 0.2, "model": "mass", "variable": "mass", "action": "bias", "value": 1.0, "duration": 0.1}
    faults = write(tmp_path, {**signal, "action": "noise", "rms": 0.1}, mass)
    inside, isolated = (
        run_oscillator(oscillator, faults, isolation=isolation) for isolation in (None, Isolation())
    )
    assert all(values.tobytes() == isolated[name].tobytes() for name, values in inside.items())


def test_the_list_says_what_acted_and_when(oscillator, tmp_path):
    events = [
        {"time": 0.1, "action": "freeze", "duration": 0.05}, {"time": 0.2, "action": "override", "value": 0.5},
        {"time": 0.3, "action": "delay", "value": 0.02}, {"time": 0.35, "action": "noise", "density": 1e-4},
        {"time": 0.4, "action": "dropout", "probability": 0.25}, {"time": 0.45, "action": "reset"},
        {"time": 0.48, "action": "scale", "value": -1, "target": "spring.position"},
        {"time": 0.6, "action": "bias", "value": 1},
    ]  # fmt: skip
    faults = write(tmp_path, *events, model="mass", variable="position")
    with Master(oscillator, 0.01, faults=faults) as master:
        master.initialise()
        master.run(0.5)
        entries = [acted.as_dict() for acted in master.faults.list_acted(master.time)]
    expected = [
        "0.100 s: mass.position frozen until 0.150 s",
        "0.200 s: mass.position replaced by 0.5 until 0.300 s",
        "0.300 s: mass.position delayed by 0.02 s until 0.350 s",
        "0.350 s: mass.position with noise of 0.0001 /Hz until 0.400 s",
        "0.400 s: mass.position lost, the last value held, in 25 % of the steps until 0.450 s",
        "0.480 s: mass.position to spring.position scaled by -1",
    ]
    assert len(entries) == len(expected)
    verify_claim(
        "master.faults",
        claim="Which faults acted, when, on what",
        where="`ps-fmu run --faults`: terminal, report, `faults` of summary.json, shading of charts",
        reference="events of the file, in words by hand; one later than the run, and one that resets, are not named",
        error=sum(entry["text"] != text for entry, text in zip(entries, expected, strict=True)),
        bound=0,
        unit="texts that differ",
    )
    assert entries[0] == {
        "from_s": 0.1, "until_s": 0.15, "signal": "mass.position", "action": "freeze", "inputs": ("spring.position",),
        "text": entries[0]["text"],
    }  # fmt: skip
    assert entries[-1]["until_s"] is None


def test_what_effects_remember_can_be_set_back(oscillator, tmp_path):
    """As before a step that is repeated; the numbers after it are the same again."""
    signal = {"time": 0.0, "model": "mass", "variable": "position", "joins": True}
    more = {"action": "dropout", "probability": 0.5}
    file = write(tmp_path, {**signal, "action": "delay", "value": 0.05}, {**signal, **more})
    clock, inputs = StepClock(0.0, 0.01), np.zeros(1)
    faults = make_faults(file, oscillator, read_descriptions(oscillator), clock, Scheme())
    faults.switch(0)
    group = faults.make_group([PortName("spring", "position")], inputs, True)
    loop = CompiledLoop(Plan(((group,),), clock.step), Rows(make_layout({}), 1), is_led=True)

    def go(first, count):
        found = []
        loop.prepare(clock.times(first, count))
        for step in range(first, first + count):
            inputs[0] = step
            loop.run_range(0, clock.time(step))
            found.append(inputs[0])
        return found

    go(0, 20)
    kept = faults.keep()
    once = go(20, 20)
    go(40, 3)
    assert go(20, 20) != once
    faults.restore(kept)
    assert go(20, 20) == once
