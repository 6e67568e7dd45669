"""The voice coil, its driver with its noise, and its current loop: pole, exact steps, energy, force over the stroke."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import expm

from ps_fmu.actuators.voice_coil import Coils, WhiteNoise, discretise
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import ParameterError, list_entries, replace_values
from ps_fmu.numerics.normal import Stream, make_key

COILS = Coils.from_parameters(load())
COIL, DRIVER = COILS.coil, COILS.driver
STEPS = (1e-5, 1e-4, 1e-3, 1e-2)  # s


def step_current(current: float, voltage: float, emf: float, h: float) -> float:
    loop = discretise(COIL, DRIVER, h)
    return loop.decay * current + loop.response * (voltage - emf)


@pytest.mark.parametrize("h", STEPS)
def test_current_at_the_end_of_a_step_is_exact(h):
    """Against the exponential of the circuit with its voltage as a second state."""
    circuit = np.array([[-COIL.resistance, 1.0], [0.0, 0.0]]) * h
    circuit[0] /= COIL.inductance
    expected = (expm(circuit) @ [0.7, 3.0 - 1.2])[0]
    assert step_current(0.7, 3.0, 1.2, h) == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize("h", STEPS)
@pytest.mark.parametrize("bandwidth", [10.0, 1000.0, 1e9])
def test_the_loop_has_the_pole_of_its_bandwidth_at_every_step(h, bandwidth):
    loop = discretise(COIL, replace(DRIVER, bandwidth=bandwidth), h)
    current, demand, emf = 0.3, 1.1, 0.4
    voltage = COIL.resistance * current + emf + loop.gain * (demand - current)
    pole = np.exp(-2.0 * np.pi * bandwidth * h)
    expected = pole * current + (1.0 - pole) * demand
    assert loop.decay * current + loop.response * (voltage - emf) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("h", STEPS)
def test_energy(h):
    """Electrical energy in = heat + magnetic + mechanical, over one step; integrals by Gauss's rule."""
    current, voltage, emf = -0.4, 5.0, 1.5
    nodes, weights = np.polynomial.legendre.leggauss(200)
    times, weights = 0.5 * h * (nodes + 1.0), 0.5 * h * weights
    final = (voltage - emf) / COIL.resistance
    course = final + (current - final) * np.exp(-COIL.resistance / COIL.inductance * times)
    end = step_current(current, voltage, emf, h)
    heat = COIL.resistance * weights @ course**2
    magnetic = 0.5 * COIL.inductance * (end**2 - current**2)
    mechanical = emf * weights @ course  # k v i: force times velocity
    assert heat + magnetic + mechanical == pytest.approx(voltage * weights @ course, rel=1e-10)


def test_a_loop_as_slow_as_the_coil_damps_like_a_voltage_source():
    """g = R: the driver then only feeds R i_c, so that the back-EMF drives the current K v / R."""
    slow = replace(DRIVER, bandwidth=COIL.resistance / (2.0 * np.pi * COIL.inductance), emf_compensation=0.0)
    for h in STEPS:
        assert discretise(COIL, slow, h).gain == pytest.approx(COIL.resistance, rel=1e-12)


def test_force_constant_over_the_stroke():
    places = np.array([-COIL.half_stroke, 0.0, 0.5 * COIL.half_stroke, COIL.half_stroke])
    np.testing.assert_allclose(COIL.compute_constant(places) / COIL.force_constant, [0.9, 1.0, 0.975, 0.9])
    rippled = replace(COIL, stroke_loss=0.0, ripple=0.05, ripple_pitch=4e-3, ripple_phase=0.5 * np.pi)
    places = np.array([0.0, 1e-3, 2e-3, 4e-3])
    np.testing.assert_allclose(rippled.compute_constant(places) / COIL.force_constant, [1.05, 1.0, 0.95, 1.05])


def test_defaults_agree_with_the_rating_of_the_data_sheet():
    """9.3 N and 14.0 W continuous: the sheet's figures agree with each other, and the limit with them."""
    continuous = 9.3 / COIL.force_constant  # A
    assert DRIVER.current_limit == pytest.approx(continuous, rel=0.01)
    assert COIL.resistance * continuous**2 == pytest.approx(14.0, rel=0.02)
    assert DRIVER.current_resolution == pytest.approx(2 * DRIVER.current_limit / 2**16, rel=0.01)


@pytest.mark.parametrize(
    ("name", "value"),
    [("coil.resistance", 0.0), ("coil.inductance", -1e-3), ("driver.emf_compensation", 1.1), ("driver.seed", -1),
     ("stop.stiffness", -1.0), ("driver.bandwidth", float("nan"))],
)  # fmt: skip
def test_impossible_values_are_named(name, value):
    with pytest.raises(ParameterError, match=name):
        replace_values(COILS, {name: value})


def test_every_parameter_is_described():
    assert all(entry.description for entry in list_entries(COILS))


def test_samples_do_not_depend_on_the_order_they_are_asked_for_in():
    whole = WhiteNoise(3, 3)(0, 2000)
    noise = WhiteNoise(3, 3)
    parts = [noise(first, 700) for first in (1400, 700, 0)]
    np.testing.assert_array_equal(np.concatenate(parts[::-1])[:2000], whole)
    np.testing.assert_array_equal(noise(511, 2), whole[511:513])
    assert np.abs(WhiteNoise(4, 3)(0, 2000) - whole).max() > 1.0


def test_white_and_of_unit_variance():
    """Variance, neighbours and channels within four deviations of what n independent samples give."""
    n = 40_000
    x = WhiteNoise(1, 3)(0, n)
    bound = 4.0 / np.sqrt(n)
    assert np.abs(x.mean(axis=0)).max() < bound
    assert np.abs((x**2).mean(axis=0) - 1.0).max() < np.sqrt(2.0) * bound
    assert np.abs((x[1:] * x[:-1]).mean(axis=0)).max() < bound
    assert np.abs((x * np.roll(x, 1, axis=1)).mean(axis=0)).max() < bound
    assert np.abs((x**4).mean(axis=0) - 3.0).max() < np.sqrt(96.0) * bound


def test_the_transform_is_that_of_box_and_muller():
    """The first half of a block has the cosines, the other one the sines."""
    sequence = np.random.SeedSequence(make_key(Stream.DRIVER, 5, 2))
    u, v = np.random.Generator(np.random.Philox(sequence)).random((2, 256, 3))
    radius = np.sqrt(-2.0 * np.log1p(-u))
    expected = np.concatenate([radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)])
    np.testing.assert_allclose(WhiteNoise(5, 3)(1024, 512), expected, rtol=0.0, atol=1e-13)
