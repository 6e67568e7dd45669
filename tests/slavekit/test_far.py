"""Errors from a model's arithmetic name the values that are to blame."""

from dataclasses import replace

import pytest

from ps_fmu.slavekit.author.slave import ModelError, Refused

H = 0.01  # s

pytestmark = pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numpy, on the way to a refusal


def refusal(slave, t=0.0, h=H):
    with pytest.raises((ModelError, Refused)) as error:
        slave.do_step(t, h)
    return str(error.value)


def test_inputs(make, put):
    slave = make("oscillator")
    put(slave, load=1e308)
    assert slave.do_step(0.0, H)
    text = refusal(slave, H, 100.0)
    assert "not finite: position" in text
    assert text.endswith("far beyond what is usual: load = 1e+308 N")
    assert slave.do_step(H, H)


def test_parameters_the_furthest_first(make):
    slave = make("oscillator", stiffness=1e300, mass=1e200)
    assert refusal(slave, 0.0, 1e300).endswith("usual: step size 1e+300 s, stiffness = 1e+300 N/m, mass = 1e+200 kg")


def test_the_step_size(make):
    slave = make("oscillator")
    assert refusal(slave, 0.0, 1e200).endswith("step_map contains numbers that are not finite; "
                                               "far beyond what is usual: step size 1e+200 s")  # fmt: skip
    assert slave.do_step(0.0, H)


def test_an_error_that_names_such_a_value_or_a_text_is_left_alone(make, put):
    slave = make("oscillator", stiffness=1e20)
    put(slave, reference=1e7)
    assert refusal(slave).endswith("reference = 10000000.0 m: expected at most 1 m")
    with pytest.raises(ModelError, match=r"note: 'impossible' is not possible$"):
        make("oscillator", stiffness=1e20, note="impossible")


def test_a_mistake_in_a_model_passes_where_all_is_usual(make, toys, monkeypatch):
    monkeypatch.setattr(toys["oscillator"], "step_map", lambda self, h: 1.0 / 0.0)
    with pytest.raises(ZeroDivisionError):
        make("oscillator").do_step(0.0, H)
    slave = make("oscillator", stiffness=1e20)
    assert "ZeroDivisionError: float division by zero; far beyond what is usual: stiffness" in refusal(slave)
    monkeypatch.setattr(toys["oscillator"], "step_map", lambda self, h: self.nothing)
    with pytest.raises(AttributeError):
        slave.do_step(0.0, H)


def test_in_initialisation(make, toys, monkeypatch):
    slave = make("oscillator", until="initialisation", mass=1e300)
    monkeypatch.setattr(toys["oscillator"], "configure", lambda self: self.value("mass") ** 2)
    with pytest.raises(ModelError, match=r"OverflowError: .*; far beyond what is usual: mass = 1e\+300 kg"):
        slave.exit_initialization_mode()


def test_in_a_state(make, toys, monkeypatch):
    slave = make("oscillator")
    state = replace(slave._get_fmu_state(), derived=None)  # as one from bytes
    state.buffer[slave.layout.find("mass")] = 1e300
    monkeypatch.setattr(toys["oscillator"], "restore", lambda self: self.value("mass") ** 2)
    with pytest.raises(ModelError, match=r"usual: mass = 1e\+300 kg"):
        slave._set_fmu_state(slave._fmu_state_from_bytes(slave._fmu_state_to_bytes(state)))
    assert slave.value("mass") == 2.0
