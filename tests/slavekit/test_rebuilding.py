"""FMU state in the instance that gave it: a model is rebuilt only where it has derived anything since."""

import math

import numpy as np
import pytest
from support.states import drive

from ps_fmu.slavekit.author.slave import ModelError

H = 0.01  # s


def go(slave, first, n, h=H):
    """Steps without an event."""
    name = "load" if "load" in slave.layout.reference else "signal"
    rows = []
    for i in range(first, first + n):
        if name in slave.layout.reference:
            slave.set_real([slave.layout.find(name)], [0.5 * math.sin(i)])
        assert slave.do_step(slave.time, h)
        rows.append(slave.get_real([0, 1]))
    return rows


@pytest.fixture
def count_restores(monkeypatch):
    """Count how often a slave is rebuilt: ``count_restores(slave)`` is a list that grows."""

    def watch(slave):
        calls, restore = [], slave.restore
        monkeypatch.setattr(slave, "restore", lambda: (calls.append(slave.time), restore()))
        return calls

    return watch


@pytest.mark.parametrize("name", ["oscillator", "waves", "limiter", "channel"])
@pytest.mark.parametrize("n", [1, 33, 130])
@pytest.mark.parametrize("h", [H, H / 2])
def test_nothing_is_rebuilt_where_nothing_was_derived_since(make, count_restores, name, n, h):
    """Also at another step size; a model with an event before each step is rebuilt."""
    slave = make(name)
    go(slave, 0, 5)
    state = slave._get_fmu_state()
    other = make(name)
    other._set_fmu_state(slave._fmu_state_from_bytes(slave._fmu_state_to_bytes(state)))
    expected = go(other, 5, 70)
    calls = count_restores(slave)
    for _ in range(3):
        go(slave, 5, n, h)
        slave._set_fmu_state(state)
        assert slave._fmu_state_to_bytes(slave._get_fmu_state()) == slave._fmu_state_to_bytes(state)
        assert go(slave, 5, 70) == expected
        slave._set_fmu_state(state)
    assert len(calls) == (6 if name in ("limiter", "waves") else 0)


@pytest.mark.parametrize("name", ["oscillator", "waves", "channel"])
def test_steps_made_again_in_memory_are_those_of_the_bytes(make, name):
    """States of many points, set in any order, with events between them."""
    slave, states, expected = make(name), {}, {}
    for i in range(0, 120, 8):
        states[i] = slave._get_fmu_state()
        expected[i] = drive(slave, i, 8)
    other = make(name)
    for i in np.random.default_rng(3).permutation(list(states) * 3).tolist():
        slave._set_fmu_state(states[i])
        other._set_fmu_state(other._fmu_state_from_bytes(slave._fmu_state_to_bytes(states[i])))
        assert slave._fmu_state_to_bytes(slave._get_fmu_state()) == other._fmu_state_to_bytes(other._get_fmu_state())
        assert drive(slave, i, 8) == drive(other, i, 8) == expected[i]


def test_a_model_is_rebuilt_for_a_state_of_before_an_event(make, put, count_restores):
    slave = make("oscillator")
    go(slave, 0, 3)
    state, calls = slave._get_fmu_state(), count_restores(slave)
    expected = go(slave, 3, 5)
    put(slave, reference=0.05)
    go(slave, 8, 1)
    slave._set_fmu_state(state)
    assert len(calls) == 1
    assert go(slave, 3, 5) == expected
    slave._set_fmu_state(state)  # it has been rebuilt since: this may be another model
    assert len(calls) == 2
    state = slave._get_fmu_state()
    go(slave, 3, 5)
    slave._set_fmu_state(state)
    assert len(calls) == 2


def test_a_model_is_rebuilt_for_a_state_of_other_parameters(make, count_restores):
    slave, other = make("oscillator", mass=2.0), make("oscillator", mass=7.0)
    for each in (slave, other):
        go(each, 0, 3)
    state = other._get_fmu_state()
    expected = go(other, 3, 5)
    calls = count_restores(slave)
    slave._set_fmu_state(state)
    assert (slave.value("mass"), len(calls)) == (7.0, 1)
    assert go(slave, 3, 5) == expected


def test_a_refused_event_leaves_no_derived_data(make, put, count_restores):
    """The event changes the model before it is refused; the model is rebuilt then, and for a state of before."""
    slave = make("oscillator")
    go(slave, 0, 3)
    state, expected = slave._get_fmu_state(), None
    calls = count_restores(slave)
    put(slave, reference=2.0)
    with pytest.raises(ModelError):
        slave.do_step(slave.time, H)
    assert len(calls) == 1
    for _ in range(2):
        slave._set_fmu_state(state)
        found = go(slave, 3, 5)
        expected = expected or found
        assert found == expected
    assert len(calls) == 3
