"""system/VoiceCoils.ssd: the voice coils between isolator and plant, in the closed loop."""

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from support.cosim import simulate

from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.cosim import Master, System, read_parameters, read_system
from ps_fmu.mechanism.parameters import load

ROOT = Path(__file__).parents[2]
SSD = ROOT / "system" / "VoiceCoils.ssd"
STEP = 1e-4  # s


@pytest.fixture(scope="module")
def coils(built_fmus) -> System:
    return read_system(SSD, built_fmus)


def test_the_wiring_fits_the_fmus(coils):
    master = Master(coils)
    assert master.wiring.loops == ()
    assert len(coils.connections) == 30
    open_inputs = {str(item.port) for item in master.open_inputs if str(item.port).startswith("coils")}
    assert open_inputs == {f"coils.added_force_command_{i}" for i in (1, 2, 3)}


def test_ideal_coils_are_a_delay_of_one_step(coils, built_fmus):
    """The default system with one step of delay in its isolator."""
    ideal = dict(read_parameters(ROOT / "system" / "parameters" / "coils_ideal.ssv"))
    found = simulate(coils.with_parameters(ideal), STEP, 0.2)
    default = read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus)
    expected = simulate(default.with_parameters({"isolator.delay": STEP}), STEP, 0.2)
    for name in [f"plant.payload_rotation.{axis}" for axis in "xyz"]:
        size = np.abs(expected[name]).max()
        np.testing.assert_allclose(found[name], expected[name], rtol=0.0, atol=1e-9 * size)
    np.testing.assert_allclose(
        found["coils.fine_force_2"][1:], found["isolator.fine_force_2"][:-1], rtol=1e-9, atol=1e-12
    )


def test_default_coils_follow_the_isolator(coils):
    """The demand through the pole of the current loop, and what resolution and noise add to it."""
    found, driver = simulate(coils, STEP, 1.0), Coils.from_parameters(load()).driver
    pole = np.exp(-2.0 * np.pi * driver.bandwidth * STEP)
    variance = driver.current_resolution**2 / 12.0 + driver.noise**2 / (2.0 * STEP)  # A2
    for i in (1, 2, 3):
        demand = found[f"isolator.fine_force_{i}"]
        followed = lfilter([0.0, 1.0 - pole], [1.0, -pole], demand)
        error = found[f"coils.fine_force_{i}"] - followed
        assert np.sqrt(np.mean(demand**2)) > 5.0 * np.sqrt(np.mean(error**2))
        assert np.var(error) == pytest.approx(3.9**2 * variance * (1.0 - pole) / (1.0 + pole), rel=0.2)
        assert 0.0 < found[f"coils.power_{i}"].max() < 1.0  # W
    assert not found["coils.saturated"].any()
    assert found["coils.contacts"][-1] == 0.0


def test_a_payload_that_is_pushed_meets_the_stops(coils):
    """A wrench on the payload for 30 ms: the stops hold the legs, take energy, and the motion dies down."""
    quiet = {"disturbance.noise.enabled": False, "isolator.enabled": False}
    pushed = coils.with_parameters(quiet | {"plant.payload_force.x": 200.0, "plant.payload_force.z": 400.0})
    found = simulate(pushed, STEP, 1.0, events=[(0.03, f"plant.payload_force.{axis}", 0.0) for axis in "xz"])
    displacement = np.abs([found[f"plant.fine_displacement_{i}"] for i in (1, 2, 3)]).max(axis=0)
    assert found["coils.contacts"][-1] >= 2.0
    assert (np.diff(found["coils.contacts"]) >= 0.0).all()
    assert 2e-3 < displacement.max() < 4e-3
    assert displacement[-2000:].max() < displacement.max()
    touching = found["coils.contact"].astype(bool)
    pushes = np.abs([found[f"coils.stop_force_{i}"] for i in (1, 2, 3)]).max(axis=0) > 0.0
    np.testing.assert_array_equal(touching, pushes)
