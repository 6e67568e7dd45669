"""The line-of-sight loop in closed form: the split, the cut, margins and what reaches the payload."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.mechanics import PAPER

from ps_fmu.control.pointing import PointingLaw
from ps_fmu.mechanism.parameters import load
from ps_fmu.theory.line_of_sight import (
    PointingLoop,
    Timing,
    cut_axis,
    find_margins,
    keeps_margins,
    margins_of,
    split,
)
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sensed_isolation import SensedIsolation
from ps_fmu.theory.transmissibility import from_base

SPLIT_HZ = 0.02
TIMING = Timing(sample_time=0.01, latency=0.01, step=1e-4)


def make_loop(bus="OSM", rpy_deg=(0.0, 0.0, 0.0), split_hz=SPLIT_HZ):
    p = load(bus=bus)
    p = replace(p, filters=replace(p.filters, highpass_frequency=split_hz))
    orientation = np.radians(rpy_deg)
    control = PointingLaw.from_parameters(p).controller(orientation)
    return PointingLoop(loop_at(p, orientation, 1.5e-4), control, TIMING)


LOOP = make_loop()
FREQUENCY = np.geomspace(1e-3, 20.0, 60)  # Hz


def test_the_shares_add_up_to_one_at_every_frequency():
    shares = split(LOOP, 2j * np.pi * FREQUENCY)
    np.testing.assert_allclose(shares.isolator + shares.loop + shares.left, 1.0, atol=1e-13)


def test_the_loop_has_the_low_frequencies_and_the_isolator_the_high_ones():
    low, high = 2j * np.pi * 1e-4, 2j * np.pi * 1e2
    assert abs(split(LOOP, low).loop) == pytest.approx(1.0, abs=1e-4)
    assert abs(split(LOOP, high).isolator) == pytest.approx(1.0, abs=1e-3)


def test_what_is_left_of_a_turn_of_the_bus_is_what_the_split_says():
    """The whole plant against the closed form, far below the suspension."""
    s = 2j * np.pi * np.geomspace(2e-3, 0.3, 12)
    turned = np.linalg.solve(np.eye(3) + LOOP.transfer(s), from_base(LOOP.loop, s, active=True))[..., 3:]
    R = LOOP.loop.model.dynamics.pose.rotation_BP
    expected = split(LOOP, s).left[:, None, None] * R.T
    deviation = np.linalg.norm(turned - expected, axis=(1, 2)) / np.linalg.norm(expected, axis=(1, 2))
    # The feedforward ends below the suspension; (0.3 / 5)^2 is 0.004.
    verify_claim(
        "sensor.split",
        claim="Shares of the bus's rotation: cancelled by the isolator, by the loop, left to the payload",
        where="report of `ps-fmu run pointing`: chart of the split",
        reference="whole plant with isolator and loop, below 0.3 Hz",
        error=deviation,
        bound=0.05,
    )


def test_a_cut_loop_and_the_closed_others_make_the_whole():
    """det(E + L) = (1 + l) det(E + L of the others)."""
    random = np.random.default_rng(3)
    L = random.normal(size=(5, 3, 3)) + 1j * random.normal(size=(5, 3, 3))
    for axis in range(3):
        others = [i for i in range(3) if i != axis]
        rest = np.linalg.det(np.eye(2) + L[:, others][:, :, others])
        np.testing.assert_allclose((1.0 + cut_axis(L, axis)) * rest, np.linalg.det(np.eye(3) + L), rtol=1e-10)


def test_margins_of_a_loop_that_text_books_have():
    """L = w exp(-s tau) / s: phase margin 90 deg - w tau, gain margin pi / (2 w tau)."""
    w, tau = 2.0 * np.pi, 0.05
    frequency = np.geomspace(0.01, 20.0, 4000)
    s = 2j * np.pi * frequency
    found = margins_of(frequency, w / s * np.exp(-s * tau), "x")
    assert found.phase_deg == pytest.approx(90.0 - np.degrees(w * tau), abs=0.01)
    assert found.gain_db == pytest.approx(20.0 * np.log10(np.pi / (2.0 * w * tau)), abs=0.01)
    assert found.crossover_hz == pytest.approx(1.0, rel=1e-4)


@pytest.mark.parametrize(("bus", "rpy_deg"), [("OSM", (8.5, 0.0, 0.0)), ("LSM", (0.0, 0.0, 14.0))])
def test_the_default_design_keeps_its_margins(bus, rpy_deg):
    for margins in find_margins(make_loop(bus, rpy_deg)):
        assert keeps_margins(margins)
        assert margins.gain_db > 9.5
        assert margins.phase_deg > 45.0


def test_without_the_isolator_the_loop_keeps_margins_too():
    assert all(map(keeps_margins, find_margins(replace(LOOP, isolated=False))))


def test_noise_of_the_tracker_is_what_the_target_makes():
    """At low frequencies the payload follows: density 2 T sigma^2."""
    isolation = SensedIsolation(LOOP.loop, PAPER.bus, PAPER.noise, TIMING.step, lines=np.array([1e-3]))
    found = isolation.solve(None, 1.0, (LOOP.control, TIMING))
    density = found.tracker_density(np.array([1e-6, 2e-6, 0.0]), TIMING.sample_time)[0]
    assert density[2, 2].real == pytest.approx(0.0, abs=1e-20)
    verify_claim(
        "sensor.tracker_noise",
        claim="Pointing error that the tracker's noise makes",
        where="`ps-fmu analyse sensors`: jitter with a line-of-sight loop",
        reference="density 2 T sigma^2 of a sampled white noise, which the payload follows at low frequencies",
        error=np.abs(np.diag(density)[:2].real / [0.02e-12, 0.08e-12] - 1.0),
        bound=1e-3,
    )


def test_the_paper_set_is_the_default():
    assert PointingLaw.from_parameters(PAPER).payload.com_P.tolist() == PAPER.known_com_P.tolist()
