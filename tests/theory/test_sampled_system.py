"""The system as its FMUs step it: against continuous time, against the steps written out, and against the loops."""

import numpy as np
import pytest

from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.control.pointing import PointingLaw
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import ParameterError, replace_values
from ps_fmu.pointing.modal import StateSpace
from ps_fmu.sensors.defaults import default_sensors
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER
from ps_fmu.theory.line_of_sight import PointingLoop, Timing
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.sampled_line_of_sight import SampledPointing, close_loop
from ps_fmu.theory.sampled_system import (
    ACCELERATION,
    FORCES,
    WRENCH,
    Block,
    connect,
    make_coils_block,
    make_isolator_block,
    make_plant_block,
    make_sensors_block,
)
from ps_fmu.theory.sensed_isolation import SensedIsolation, sensing_response
from ps_fmu.theory.transmissibility import from_wrench

STEP = 1e-4  # s
ROTATION = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")
DIRECT = [(f"plant.{name}", f"isolator.{name}") for name in ACCELERATION]
FORCED = [(f"isolator.{name}", f"plant.{name}") for name in FORCES]
SENSED = [(f"plant.{name}", f"sensors.{name}") for name in ACCELERATION] + [
    (f"sensors.{name.replace('base', 'estimated')}", f"isolator.{name}") for name in ACCELERATION
]


@pytest.fixture(scope="module")
def loop():
    return loop_at(load(), np.radians([4.0, -2.0, 1.0]))


def respond(blocks, wires, inputs, frequency, outputs=ROTATION, h=STEP):
    found = connect(blocks, wires, inputs, outputs, h)
    return StateSpace(found.A, found.B, found.C, found.step).response(frequency)


def plant_inputs(names):
    return [f"plant.{name}" for name in names]


def test_the_passive_plant_is_that_of_continuous_time_held(loop):
    frequency = np.array([0.1, 1.0, 5.1, 20.0, 100.0])
    found = respond({"plant": make_plant_block(loop.model, STEP)}, [], plant_inputs(WRENCH), frequency)
    s = 2j * np.pi * frequency
    held = -np.expm1(-s * STEP) / (s * STEP)
    expected = from_wrench(loop, s, active=False) * held[:, None, None]
    # What folds down from above half the rate falls with f^2.
    assert found == pytest.approx(expected, rel=2e-4, abs=1e-6 * np.abs(expected).max())


def test_the_isolated_plant_has_a_delay_of_one_and_a_half_steps(loop):
    frequency = np.array([2.0, 5.1, 20.0, 100.0])
    blocks = {"plant": make_plant_block(loop.model, STEP), "isolator": make_isolator_block(loop.controller, STEP)}
    found = np.abs(respond(blocks, DIRECT + FORCED, plant_inputs(WRENCH), frequency))
    expected = np.abs(from_wrench(loop.with_delay(1.5 * STEP), 2j * np.pi * frequency, active=True))
    largest = expected.max(axis=(1, 2), keepdims=True)
    assert np.abs(found - expected).max(axis=(1, 2)) == pytest.approx(np.zeros(4), abs=2e-3 * largest.max())


def test_the_model_steps_as_its_blocks_do(loop):
    """A hundred steps written out, with sensors, isolator with delay, and coils, driven by random numbers."""
    sensors = replace_values(default_sensors(), {"latency": 2e-4})
    blocks = {
        "plant": make_plant_block(loop.model, STEP),
        "sensors": make_sensors_block(sensors, STEP),
        "isolator": make_isolator_block(loop.controller, STEP, 3e-4),
        "coils": make_coils_block(Coils.from_parameters(load()), STEP),
    }
    wires = [
        *SENSED,
        *((f"isolator.{force}", f"coils.force_command_{i}") for i, force in enumerate(FORCES, 1)),
        *((f"coils.{force}", f"plant.{force}") for force in FORCES),
        *((f"plant.fine_velocity_{i}", f"coils.fine_velocity_{i}") for i in (1, 2, 3)),
    ]
    inputs = [*plant_inputs(WRENCH), "sensors.noise_4", "coils.noise_2"]
    model = connect(blocks, wires, inputs, ROTATION, STEP)
    random = np.random.default_rng(2).normal(size=(100, len(inputs)))
    x, found = np.zeros(len(model.A)), []
    states = {name: np.zeros(block.n_states) for name, block in blocks.items()}
    outputs = {f"{name}.{port}": 0.0 for name, block in blocks.items() for port in block.outputs}
    expected = []
    for row in random:
        x = x + STEP * (model.A @ x + model.B @ row)
        found.append(model.C @ x)
        given = {end: outputs[start] for start, end in wires} | dict(zip(inputs, row, strict=True))
        for name, block in blocks.items():
            u = np.array([given.get(f"{name}.{port}", 0.0) for port in block.inputs])
            both = block.map @ np.concatenate([states[name], u])
            states[name] = both[len(block.outputs) :]
            outputs |= {f"{name}.{port}": y for port, y in zip(block.outputs, both, strict=False)}
        expected.append([outputs[name] for name in ROTATION])
    assert np.array(found) == pytest.approx(np.array(expected), rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_sensors_are_low_pass_hold_and_latency():
    frequency = np.array([0.5, 20.0, 150.0])
    sensors = replace_values(default_sensors(), {"sample_time": 1e-3, "latency": 2e-3})
    block = make_sensors_block(sensors, STEP)
    names = [f"sensors.{name}" for name in block.outputs]
    found = respond({"sensors": block}, [], [f"sensors.{name}" for name in ACCELERATION], frequency, names)
    expected = sensing_response(sensors, frequency, STEP)
    assert found == pytest.approx(expected[:, None, None] * np.eye(6), rel=1e-9, abs=1e-9)
    noise = respond({"sensors": block}, [], [f"sensors.noise_{k}" for k in range(1, 13)], np.array([1e-3]), names)
    assert np.abs(noise[0]) == pytest.approx(np.abs(sensors.estimator[:6, :12]), rel=1e-4, abs=1e-9)


def test_coils_have_the_pole_of_their_current_loop_and_damp_by_what_is_not_compensated():
    coils = Coils.from_parameters(load())
    frequency = np.array([1.0, 300.0])
    names = [f"coils.{name}" for name in FORCES]
    own = {"coils": make_coils_block(coils, STEP)}
    pole, z = np.exp(-2.0 * np.pi * coils.driver.bandwidth * STEP), np.exp(2j * np.pi * frequency * STEP)
    command = respond(own, [], ["coils.force_command_2"], frequency, names)
    assert command[:, 1, 0] == pytest.approx((1.0 - pole) / (z - pole), rel=1e-9)
    noise = respond(own, [], ["coils.noise_2"], frequency, names)
    assert noise == pytest.approx(coils.coil.force_constant * command, rel=1e-9)
    assert np.abs(respond(own, [], ["coils.fine_velocity_2"], frequency, names)).max() < 1e-12
    voltage = replace_values(coils, {"driver.emf_compensation": 0.0, "driver.bandwidth": 306.0672})
    damped = respond({"coils": make_coils_block(voltage, STEP)}, [], ["coils.fine_velocity_2"], np.array([0.01]), names)
    assert damped[0, 1, 0].real == pytest.approx(-coils.coil.short_circuit_damping, rel=0.01)


def test_a_line_of_sight_loop_is_that_of_its_own_theory(loop):
    """Of disturbance, tracker noise and accelerometers; its delays are those of the exchange besides."""
    p = load()
    law = PointingLaw.from_parameters(p).controller(np.radians([4.0, -2.0, 1.0]))
    tracker = DEFAULT_TRACKER
    timing = Timing(tracker.sample_time, tracker.latency, STEP)
    frequency = np.array([0.05, 0.3, 1.25, 3.0, 5.1, 20.0])
    blocks = {"plant": make_plant_block(loop.model, STEP), "isolator": make_isolator_block(loop.controller, STEP)}
    inputs = plant_inputs([*WRENCH, *(f"added_{force}" for force in FORCES)])
    whole = respond(blocks, DIRECT + FORCED, inputs, frequency)
    closed = close_loop(SampledPointing(law, timing).response(frequency), whole, whole, slice(6, 9))
    s = 2j * np.pi * frequency
    theory = PointingLoop(loop.with_delay(1.5 * STEP), law, timing)
    for part, expected in ((closed[..., 6:], theory.from_target(s)), (closed[..., :6], theory.from_wrench(s))):
        size = np.abs(expected).max(axis=(1, 2))
        # Below 1 Hz the isolator leaves so little of the wrench that what a step does besides its delay is seen.
        rows = slice(0, None) if part.shape[-1] == 3 else slice(2, None)
        assert (np.abs(np.abs(part) - np.abs(expected)).max(axis=(1, 2)) / size)[rows].max() < 0.02
    no_roll = SampledPointing(law, timing, roll_measured=False).response(frequency)
    assert not no_roll[..., 2].any()
    assert no_roll[..., :2].all()


def test_parts_of_a_response_add_up_in_the_closed_loop():
    random = np.random.default_rng(1)
    parts, K = (random.normal(size=shape) + 1j * random.normal(size=shape) for shape in ((4, 5, 3, 8), (5, 3, 3)))
    closed = close_loop(K, parts.sum(axis=0), parts, slice(5, 8))
    whole = close_loop(K, parts.sum(axis=0), parts.sum(axis=0), slice(5, 8))
    assert closed.sum(axis=0) == pytest.approx(whole, rel=1e-9, abs=0.0)


def test_with_sensors_it_is_the_isolation_of_its_own_theory(loop):
    p, sensors = load(), default_sensors()
    frequency = np.array([0.3, 1.0, 5.1, 20.0])
    isolation = SensedIsolation(loop, p.bus, p.noise, STEP, lines=frequency)
    expected = isolation.solve(sensors, p.filters.highpass_frequency).to_wrench
    blocks = {
        "plant": make_plant_block(loop.model, STEP),
        "sensors": make_sensors_block(sensors, STEP),
        "isolator": make_isolator_block(loop.controller, STEP),
    }
    found = respond(blocks, SENSED + FORCED, plant_inputs(WRENCH), frequency)
    size = np.abs(expected).max(axis=(1, 2))
    assert (np.abs(np.abs(found) - np.abs(expected)).max(axis=(1, 2)) / size).max() < 0.02


def test_what_has_no_closed_form_is_refused(loop):
    with pytest.raises(ParameterError, match=r"delay: expected a multiple of the step of 0\.0001 s, got 0\.00015 s"):
        make_isolator_block(loop.controller, STEP, 1.5e-4)
    with pytest.raises(ParameterError, match="delay: expected at most 40 steps in closed form, got 300"):
        make_isolator_block(loop.controller, STEP, 0.03)
    block = Block(("u",), ("y",), np.array([[1.0]]))
    with pytest.raises(KeyError, match=r"a\.v"):
        connect({"a": block}, [], ["a.v"], ["a.y"], STEP)
