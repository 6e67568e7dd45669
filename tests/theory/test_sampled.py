"""What a step does: against the steps written out, continuous time, the theories of the loops, and lines of a wheel."""

from dataclasses import replace

import numpy as np
import pytest
from support.claims import verify_claim
from support.cosim import Collect
from support.mechanics import ORIENTATIONS_DEG, PAPER

from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.control.feedforward import Controller
from ps_fmu.control.pointing import PointingLaw
from ps_fmu.cosim import Master, read_system
from ps_fmu.disturbance import default_settings
from ps_fmu.disturbance.wheels import SpeedProfile, WheelSource
from ps_fmu.interface.start_values import build_plant_and_isolator
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import ParameterError, replace_values
from ps_fmu.mechanism.signals import N_INPUTS, N_OUTPUTS, output_slices
from ps_fmu.numerics.normal import Stream, make_key
from ps_fmu.product.files import find_product
from ps_fmu.sensors.inertial import default_sensors
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER
from ps_fmu.theory.line_of_sight import PointingLoop, SampledPointing, Timing, close_loop
from ps_fmu.theory.loop import Loop, loop_at, loop_of
from ps_fmu.theory.sampled import (
    ACCELERATION,
    FORCES,
    WRENCH,
    Block,
    connect,
    from_base_sampled,
    from_wrench_stepped,
    make_coils_block,
    make_isolator_block,
    make_plant_block,
    make_sensors_block,
)
from ps_fmu.theory.sensed_isolation import SensedIsolation, sensing_response
from ps_fmu.theory.transmissibility import from_base, from_wrench

S = 2j * np.pi * np.array([0.2, 0.37, 0.45, 0.5, 1.08, 1.15, 3.0, 5.2, 5.5, 20.0, 100.0])  # rad/s
GROUPS = output_slices()


def of_map(step_map: np.ndarray, outputs: int, z: complex) -> np.ndarray:
    """Transfer matrix of ``[y; x](k + 1) = map [x; u](k)`` from u(k) to y(k)."""
    n = len(step_map) - outputs
    C, D, A, B = step_map[:outputs, :n], step_map[:outputs, n:], step_map[outputs:, :n], step_map[outputs:, n:]
    return (C @ np.linalg.solve(z * np.eye(n) - A, B) + D) / z


def exact(loop: Loop, s: complex, h: float) -> np.ndarray:
    """Payload rotation by base motion at the ends of the steps, forces and accelerations exchanged once a step."""
    z = np.exp(s * h)
    plant = of_map(loop.model.step_map(h), sum(size.stop - size.start for size in GROUPS.values()), z)
    motion = [*range(*GROUPS["base_position"].indices(99)), *range(*GROUPS["base_rotation"].indices(99))]
    acceleration = range(6)
    rotation = [*range(*GROUPS["payload_rotation"].indices(99))]
    K = of_map(loop.controller.step_map(h), 3, z)
    forces, wrench = plant[:, :3], plant[:, 3:9]
    F = np.linalg.solve(np.eye(3) - K @ forces[acceleration], K @ wrench[acceleration])  # wrench to force
    return (wrench[rotation] + forces[rotation] @ F) @ np.linalg.inv(wrench[motion] + forces[motion] @ F)


@pytest.mark.parametrize("rpy", ORIENTATIONS_DEG[:2])
@pytest.mark.parametrize(("h", "allowed"), [(1e-4, 2e-3), (1e-3, 2e-2)])  # s; second order in the step is left out
def test_against_the_step_maps(rpy, h, allowed):
    loop = loop_at(PAPER, np.radians(rpy))
    s = S[: len(S) if h < 5e-4 else -2]
    expected = np.stack([exact(loop, point, h) for point in s])
    found = from_base_sampled(loop, s, h)
    size = np.linalg.norm(expected, ord=2, axis=(1, 2))
    assert (np.linalg.norm(found - expected, ord=2, axis=(1, 2)) < allowed * size).all()
    # It is not the step that is small: without it the error is fifty times as large.
    without = from_base(loop, s, active=True)
    assert (np.linalg.norm(without - expected, ord=2, axis=(1, 2)) / size).max() > 50.0 * allowed


def test_a_step_of_no_length_changes_nothing():
    loop = loop_at(PAPER, delay=5e-3)
    assert from_base_sampled(loop, S, 0.0) == pytest.approx(from_base(loop, S, active=True), rel=1e-9, abs=1e-12)


STEP = 1e-4  # s
PLACES = np.arange(N_OUTPUTS)[output_slices()["payload_rotation"]]
LOOP = loop_at(load(), np.radians([8.5, 0.0, 0.0]))


def simulate(wrench):
    """Payload rotation (steps + 1, 3) under wrenches (steps, 6), each held for a step."""
    plant, isolator = LOOP.model.step_map(STEP), LOOP.controller.step_map(STEP)
    x, c, a, f = np.zeros(LOOP.model.n_states), np.zeros(LOOP.controller.n_states), np.zeros(6), np.zeros(3)
    u, rows = np.zeros(N_INPUTS), [np.zeros(3)]
    for w in wrench:
        u[:3], u[3:9] = f, w
        found = plant @ np.concatenate([x, u])
        x = found[N_OUTPUTS:]
        answer = isolator @ np.concatenate([c, a])
        f, c, a = answer[:3], answer[3:], found[:6]
        rows.append(found[PLACES])
    return np.array(rows)


ROTATION = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")
DIRECT = [(f"plant.{name}", f"isolator.{name}") for name in ACCELERATION]
FORCED = [(f"isolator.{name}", f"plant.{name}") for name in FORCES]
SENSED = [(f"plant.{name}", f"sensors.{name}") for name in ACCELERATION] + [
    (f"sensors.{name.replace('base', 'estimated')}", f"isolator.{name}") for name in ACCELERATION
]


@pytest.fixture(scope="module")
def loop():
    return loop_at(load(), np.radians([4.0, -2.0, 1.0]))


def answer(blocks, wires, inputs, frequency, outputs=ROTATION, h=STEP):
    return connect(blocks, wires, inputs, outputs, h).response(frequency)


def plant_inputs(names):
    return [f"plant.{name}" for name in names]


def test_plant_and_isolator_wired_are_what_the_models_do_step_by_step():
    blocks = {"plant": make_plant_block(LOOP.model, STEP), "isolator": make_isolator_block(LOOP.controller, STEP)}
    model = connect(blocks, DIRECT + FORCED, plant_inputs(WRENCH), ROTATION, STEP)
    wrench = np.random.default_rng(1).normal(size=(60, 6))
    x, rows = np.zeros(len(model.A)), []
    for w in [*wrench, np.zeros(6)]:
        rows.append(model.C @ x)
        x = x + STEP * (model.A @ x + model.B @ w)
    expected = simulate(wrench)
    assert np.array(rows) == pytest.approx(expected, rel=1e-9, abs=1e-9 * np.abs(expected).max())


def test_the_passive_plant_is_that_of_continuous_time_held(loop):
    frequency = np.array([0.1, 1.0, 5.1, 20.0, 100.0])
    found = answer({"plant": make_plant_block(loop.model, STEP)}, [], plant_inputs(WRENCH), frequency)
    s = 2j * np.pi * frequency
    held = -np.expm1(-s * STEP) / (s * STEP)
    expected = from_wrench(loop, s, active=False) * held[:, None, None]
    # What folds down from above half the rate falls with f^2.
    assert found == pytest.approx(expected, rel=2e-4, abs=1e-6 * np.abs(expected).max())


def test_the_isolated_plant_has_a_delay_of_one_and_a_half_steps(loop):
    frequency = np.array([2.0, 5.1, 20.0, 100.0])
    blocks = {"plant": make_plant_block(loop.model, STEP), "isolator": make_isolator_block(loop.controller, STEP)}
    found = np.abs(answer(blocks, DIRECT + FORCED, plant_inputs(WRENCH), frequency))
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
    found = answer({"sensors": block}, [], [f"sensors.{name}" for name in ACCELERATION], frequency, names)
    expected = sensing_response(sensors, frequency, STEP)
    assert found == pytest.approx(expected[:, None, None] * np.eye(6), rel=1e-9, abs=1e-9)
    noise = answer({"sensors": block}, [], [f"sensors.noise_{k}" for k in range(1, 13)], np.array([1e-3]), names)
    assert np.abs(noise[0]) == pytest.approx(np.abs(sensors.estimator[:6, :12]), rel=1e-4, abs=1e-9)


def test_coils_have_the_pole_of_their_current_loop_and_damp_by_what_is_not_compensated():
    coils = Coils.from_parameters(load())
    frequency = np.array([1.0, 300.0])
    names = [f"coils.{name}" for name in FORCES]
    own = {"coils": make_coils_block(coils, STEP)}
    pole, z = np.exp(-2.0 * np.pi * coils.driver.bandwidth * STEP), np.exp(2j * np.pi * frequency * STEP)
    command = answer(own, [], ["coils.force_command_2"], frequency, names)
    assert command[:, 1, 0] == pytest.approx((1.0 - pole) / (z - pole), rel=1e-9)
    noise = answer(own, [], ["coils.noise_2"], frequency, names)
    assert noise == pytest.approx(coils.coil.force_constant * command, rel=1e-9)
    assert np.abs(answer(own, [], ["coils.fine_velocity_2"], frequency, names)).max() < 1e-12
    voltage = replace_values(coils, {"driver.emf_compensation": 0.0, "driver.bandwidth": 306.0672})
    damped = answer({"coils": make_coils_block(voltage, STEP)}, [], ["coils.fine_velocity_2"], np.array([0.01]), names)
    assert damped[0, 1, 0].real == pytest.approx(-(coils.coil.force_constant**2) / coils.coil.resistance, rel=0.01)


def test_a_line_of_sight_loop_is_that_of_its_own_theory(loop):
    """Of disturbance, tracker noise and accelerometers; its delays are those of the exchange besides."""
    p = load()
    law = PointingLaw.from_parameters(p).controller(np.radians([4.0, -2.0, 1.0]))
    tracker = DEFAULT_TRACKER
    timing = Timing(tracker.sample_time, tracker.latency, STEP)
    frequency = np.array([0.05, 0.3, 1.25, 3.0, 5.1, 20.0])
    s = 2j * np.pi * frequency
    blocks = {"plant": make_plant_block(loop.model, STEP), "isolator": make_isolator_block(loop.controller, STEP)}
    inputs = plant_inputs([*WRENCH, *(f"added_{force}" for force in FORCES)])
    whole = answer(blocks, DIRECT + FORCED, inputs, frequency)
    closed = close_loop(SampledPointing(law, timing).response(s), whole, whole, slice(6, 9))
    theory = PointingLoop(loop.with_delay(1.5 * STEP), law, timing)
    L = theory.transfer(s)
    to_wrench, to_target = (np.linalg.solve(np.eye(3) + L, G) for G in (from_wrench(theory.loop, s, active=True), L))
    for part, expected in ((closed[..., 6:], to_target), (closed[..., :6], to_wrench)):
        size = np.abs(expected).max(axis=(1, 2))
        # Below 1 Hz the isolator leaves so little of the wrench that what a step does besides its delay is seen.
        rows = slice(0, None) if part.shape[-1] == 3 else slice(2, None)
        assert (np.abs(np.abs(part) - np.abs(expected)).max(axis=(1, 2)) / size)[rows].max() < 0.02
    no_roll = SampledPointing(law, timing, roll_measured=False).response(s)
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
    found = answer(blocks, SENSED + FORCED, plant_inputs(WRENCH), frequency)
    size = np.abs(expected).max(axis=(1, 2))
    assert (np.abs(np.abs(found) - np.abs(expected)).max(axis=(1, 2)) / size).max() < 0.02


def test_what_has_no_closed_form_is_refused(loop):
    with pytest.raises(ParameterError, match=r"sample_time: expected a multiple of the step of 0\.0001 s, got 0\.0015"):
        make_sensors_block(replace(default_sensors(), sample_time=1.503e-3), STEP)
    with pytest.raises(ParameterError, match="delay: expected at most 40 steps in closed form, got 300"):
        make_isolator_block(loop.controller, STEP, 0.03)
    block = Block(("u",), ("y",), np.array([[1.0]]))
    with pytest.raises(KeyError, match=r"a\.v"):
        connect({"a": block}, [], ["a.v"], ["a.y"], STEP)


SPEED = 2.0 * np.pi * 40.0  # rad/s
RISE, WINDOW = 1.0, 1.0  # s
DELAY = 5 * STEP
QUANTITY = [f"plant.payload_rotation.{axis}" for axis in "xyz"]


@pytest.fixture(scope="module", params=["passive", "active", "active, delayed"])
def lines(request, built_fmus):
    """Amplitudes (lines, 3) found in a run of the FMUs and in closed form, and frequencies (lines,), Hz."""
    active, delay = request.param != "passive", DELAY if "delayed" in request.param else 0.0
    values = {
        "disturbance.noise.enabled": False, "disturbance.wheel_1.enabled": True, "disturbance.rise_time": RISE,
        "disturbance.wheel_1.initial_speed": SPEED, "disturbance.wheel_1.final_speed": SPEED,
        "isolator.enabled": active, "isolator.delay": delay,
    }  # fmt: skip
    system = read_system(find_product().system / "SystemStructure.ssd", built_fmus).with_parameters(values)
    kept = Collect()
    with Master(system, STEP) as master:
        master.initialise()
        names = [column.name for column in master.columns]
        master.run(RISE + 1.0 + WINDOW, [kept])
    rows = slice(round((RISE + 1.0) / STEP), None)
    rotation = kept.values[rows][:, [names.index(name) for name in QUANTITY]]
    wheel = make_wheel()
    frequency, place = np.unique(wheel.orders * SPEED / (2.0 * np.pi), return_inverse=True)
    plant, isolator = build_plant_and_isolator(system)
    loop = loop_of(plant, isolator, (0.0, 0.0, 0.0), 0.0)
    controller = loop.controller if active else None
    G = from_wrench_stepped(loop.model, controller, frequency, STEP, delay=delay)
    expected = np.zeros((len(frequency), 3), dtype=complex)
    np.add.at(expected, place, np.einsum("nij,nj->ni", G[place], wheel.amplitudes(SPEED)))
    time = (rows.start + np.arange(len(rotation))) * STEP
    return fit_lines(time, rotation, frequency), expected, frequency


def make_wheel():
    """The first wheel of the disturbance source at the speed of the run."""
    settings = replace_values(default_settings(load()), {"seed": 1})
    wheel = settings.kinds["wheels"][0]
    key = make_key(Stream.WHEEL, settings.seed, 1)
    return WheelSource(SpeedProfile(SPEED, SPEED, 0.0, 0.0), wheel.spin_axis_B, wheel.position_B, key)


def fit_lines(time, signal, frequency):
    """Complex amplitudes (lines, signals) by least squares, with a slow parabola, in a window with soft ends."""
    turning = np.exp(2j * np.pi * np.multiply.outer(time, frequency))
    slow = np.vander(time - time.mean(), 3)
    window = np.hanning(len(time))[:, None] ** 2
    basis = np.hstack([turning.real, -turning.imag, slow])
    found = np.linalg.lstsq(basis * window, signal * window, rcond=None)[0]
    return found[: len(frequency)] + 1j * found[len(frequency) : 2 * len(frequency)]


def test_the_lines_of_a_wheel_at_constant_speed_are_those_of_the_closed_form(lines):
    """Amplitude and phase of each harmonic.

    What is left is the motion that the fade-in leaves, slow against the window, and rounding: 1e-8 of the largest line.
    """
    found, expected, frequency = lines
    assert len(frequency) == 21
    largest = np.abs(expected).max()
    strong = np.abs(expected) > 1e-4 * largest
    assert strong.sum() > 20
    np.testing.assert_allclose(found[strong], expected[strong], rtol=1e-4)
    verify_claim(
        "wheel.constant_speed",
        claim="Amplitude of each harmonic of a wheel at constant speed, in closed form",
        where="`ps-fmu run wheels`, `analyse budget`: terminal, report, summary.json",
        reference="lines of a run of the models, by least squares: amplitude and phase of 21 harmonics",
        error=np.abs(found - expected) / largest,
        bound=1e-8,
        unit="of the largest line",
    )


def test_for_short_steps_it_is_the_continuous_closed_form():
    """Passive: the wrench is held over a step, which is half a step late and sin(x) / x of x = pi f h."""
    loop = loop_at(load())
    frequency, h = np.array([3.0, 40.0, 300.0]), 1e-5
    continuous = from_wrench(loop, 2j * np.pi * frequency, active=False)
    held = np.sinc(frequency * h) * np.exp(-1j * np.pi * frequency * h)
    found = from_wrench_stepped(loop.model, None, frequency, h)
    for k in range(len(frequency)):
        size = np.abs(continuous[k]).max()
        np.testing.assert_allclose(found[k], held[k] * continuous[k], rtol=0.0, atol=1e-4 * size)


def test_an_isolator_without_gains_is_one_that_is_off():
    loop = loop_at(load())
    g = loop.controller.gains
    nothing = type(g)(0.0 * g.acceleration, 0.0 * g.velocity, 0.0 * g.displacement)
    idle = Controller(nothing, loop.controller.lowpass, loop.controller.filters)
    frequency = np.array([1.0, 100.0])
    np.testing.assert_allclose(
        from_wrench_stepped(loop.model, idle, frequency, STEP), from_wrench_stepped(loop.model, None, frequency, STEP),
        rtol=1e-12,
    )  # fmt: skip
