"""Transmissibility and jitter in closed form: Fig 8, Table 2 and Fig 9."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.mechanics import ORIENTATIONS_DEG, PAPER, closed_loop

from ps_fmu.mechanism.rotations import skew
from ps_fmu.paper.published import published_numbers
from ps_fmu.theory.loop import loop_at, plant_system
from ps_fmu.theory.transfer_matrices import Practical
from ps_fmu.theory.transmissibility import from_base, from_wrench, jitter, jitter_of_lines, singular_values_db

S = 2j * np.pi * np.geomspace(0.05, 300.0, 40)  # rad/s
NAMES = ("nominal", "roll", "pitch", "yaw")
# Published and identified rejection, percent: the identified set, analogue filters, no delay.
IDENTIFIED = ((99.36, 99.17, 97.85), (99.48, 98.94, 97.36), (99.51, 98.53, 97.48), (99.35, 98.50, 98.90))


@pytest.fixture(scope="module")
def loops():
    return [loop_at(PAPER, np.radians(rpy)) for rpy in ORIENTATIONS_DEG]


def test_passive_is_the_plants_own_in_platform_axes(loops):
    for loop in loops:
        R = loop.model.dynamics.pose.rotation_BP
        expected = R.T @ Practical(loop.model.dynamics).G_P(S)
        assert np.abs(from_base(loop, S, active=False) - expected).max() < 1e-12


@pytest.mark.parametrize("active", [False, True])
def test_from_wrench_is_the_state_space_model(loops, active):
    """python-control's interconnection of the same plant and controller, without delay."""
    loop = loops[1]
    outputs = [f"payload_rotation_{axis}" for axis in "xyz"]
    wrench = [f"base_{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]
    system = closed_loop(loop.model, loop.controller) if active else plant_system(loop.model)
    expected = np.moveaxis(system[outputs, wrench](S), -1, 0)
    assert np.abs(from_wrench(loop, S, active=active) - expected).max() < 1e-6 * np.abs(expected).max()


def test_fig_8(loops):
    """Starts at 0 dB; attenuates by 60.6, 60.5, 60.7, 60.2 dB; amplifies by less than 9 dB from 100 to 700 Hz."""
    frequency = np.geomspace(1e-2, 1000.0, 3000)  # Hz
    high = (frequency > 100.0) & (frequency < 700.0)
    for loop, attenuation in zip(loops, (60.6, 60.5, 60.7, 60.2), strict=True):
        passive, active = (
            singular_values_db(from_base(loop, 2j * np.pi * frequency, active=on))[:, 0] for on in (False, True)
        )
        assert abs(passive[0]) < 1e-3
        assert (passive - active).max() == pytest.approx(attenuation, abs=0.1)
        assert 5.0 < (active - passive)[high].max() < published_numbers()["fig8.amplification"].value


def test_table_2(loops):
    for loop, name, identified in zip(loops, NAMES, IDENTIFIED, strict=True):
        passive, active = (jitter(loop, PAPER.bus, PAPER.noise, 1.0, active=on) for on in (False, True))
        said = [published_numbers()[f"table2.{name}_passive_{axis}"].value for axis in (1, 2, 3)]
        assert 100.0 * (1.0 - active.rms / passive.rms) == pytest.approx(identified, abs=0.04)
        assert 1e-5 < passive.radius_rms < 2e-5 and 0.9e-7 < active.radius_rms < 1.4e-7  # m, Fig 9
        verify_claim(
            "paper.table_2",
            claim="Passive RMS of the payload's rotation at four orientations",
            where="`ps-fmu analyse jitter`: terminal, report, jitter.json",
            reference="Table 2 of the paper",
            error=np.abs(passive.rms / np.array(said) - 1.0),
            bound=9e-3,
        )


def test_the_grid_is_dense_enough(loops):
    """Against a uniform grid of 0.4 mHz in a band with the modes of bus and fine legs."""
    loop, noise = loops[0], replace(PAPER.noise, band=np.array([0.1, 8.0]))
    found = jitter(loop, PAPER.bus, noise, 1.0, active=True)
    frequency = np.linspace(*noise.band, 20_000)
    G = from_wrench(loop, 2j * np.pi * frequency, active=True)
    move = np.eye(6)
    move[3:, :3] = skew(PAPER.bus.com_B)
    density = (G @ (move @ noise.wrench_psd_B @ move.T) @ np.swapaxes(G.conj(), -1, -2)).real
    assert found.covariance == pytest.approx(np.trapezoid(density, frequency, axis=0), rel=1e-3)


def test_jitter_of_lines(loops):
    """Two sines: half the sum of the squared amplitudes, and the phase between the axes."""
    frequency, wrench = np.array([1.0, 7.0]), np.array([[1.0, 0, 0, 0, 2j, 0], [0, 1j, 0, 3.0, 0, 1.0]])
    found = jitter_of_lines(loops[1], frequency, wrench, 1.0, active=True)
    time = np.arange(1000) / 1000.0  # s: one period
    G = from_wrench(loops[1], 2j * np.pi * frequency, active=True)
    rotation = sum((G[k] @ wrench[k, :, None] * np.exp(2j * np.pi * frequency[k] * time)).real for k in (0, 1))
    assert found.covariance == pytest.approx(rotation @ rotation.T / time.size, rel=1e-9)


def test_image_point_of_a_rotation_about_x():
    loop = loop_at(PAPER)
    found = replace(jitter(loop, PAPER.bus, PAPER.noise, 2.0, active=False), covariance=np.diag([1.0, 0.0, 5.0]))
    assert found.image_covariance == pytest.approx(np.diag([0.0, 4.0]))
    assert found.radius_rms == 2.0
