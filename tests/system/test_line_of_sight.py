"""system/LineOfSight.ssd on the built FMUs: against one discrete system, and cut open."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim
from support.mechanics import PAPER

from ps_fmu.control.isolator import Isolator
from ps_fmu.control.pointing import PointingLaw
from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.structure import Connection, PortName
from ps_fmu.interface.linear_system import Circuit
from ps_fmu.interface.system_model import POINTING, read_model
from ps_fmu.mechanism.discretisation import zero_order_hold
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.pointing.response import slowest_mode
from ps_fmu.results.observers.sampler import SampleObserver
from ps_fmu.runs.options import OptionError, RunOptions
from ps_fmu.runs.run import execute
from ps_fmu.runs.scenario import SCENARIOS
from ps_fmu.runs.setup import load_system
from ps_fmu.scenarios.pointing_loop import build_loop, make_shaking, measure_loop
from ps_fmu.theory.line_of_sight import find_margins, keeps_margins
from ps_fmu.theory.loop import plant_system
from ps_fmu.theory.stability import find_common_margins, refine_pole
from ps_fmu.trades.stability import find_margins as find_loop_margins

LINE_OF_SIGHT = Path(__file__).parents[2] / "system" / "LineOfSight.ssd"
H = 1e-3  # s
QUIET = {
    "disturbance.noise.enabled": False,
    **{f"tracker.noise_equivalent_angle.{axis}": 0.0 for axis in "xyz"},
}
EXACT = {f"sensors.accelerometer.{error}": 0.0 for error in ("noise_density", "bias_instability", "resolution")}


def without_sensors(system):
    """The system with the isolator on the plant's own acceleration, as in SystemStructure.ssd."""
    kept = [c for c in system.connections if "sensors" not in (c.source.component, c.target.component)]
    for c in system.connections:
        if c.target.component == "isolator" and c.source.component == "sensors":
            kept.append(Connection(PortName("plant", c.target.variable), c.target, c.line))
    components = tuple(c for c in system.components if c.name != "sensors")
    return replace(system, components=components, connections=tuple(kept))


def simulate_as_one(steps, turn, sampled_every, latency_steps, highpass_hz):
    """Rotation of the payload (steps + 1, 3), rad, of plant, isolator, tracker and controller, exchanging by Jacobi."""
    filters = replace(PAPER.filters, highpass_frequency=highpass_hz)
    plant = plant_system(Plant.from_parameters(PAPER).linearise(np.zeros(3)))
    motions = [f"base_{kind}_{k}" for kind in ("acceleration", "angular_acceleration") for k in "xyz"]
    acceleration = [plant.find_output(name) for name in motions]
    rotation = [plant.find_output(f"payload_rotation_{k}") for k in "xyz"]
    seen = [*(plant.find_output(f"line_of_sight_{k}") for k in "xy"), rotation[2]]  # with the truss
    A, B = zero_order_hold(plant.A, plant.B[:, :3], H)
    isolator = replace(Isolator.from_parameters(PAPER), filters=filters).controller(np.zeros(3))
    isolate = isolator.step_map(H)
    law = PointingLaw.from_parameters(PAPER).controller(np.zeros(3))
    Ad, Bd = law.hold(H)
    x, xi, xc = np.zeros(len(A)), np.zeros(isolator.n_states), np.zeros(12)
    force, added, measured, accelerated = np.zeros(3), np.zeros(3), np.zeros(3), np.zeros(6)
    pipeline, sample, found = [np.zeros(3)] * latency_steps, np.zeros(3), [np.zeros(3)]
    for k in range(steps):
        if k % sampled_every == 0:
            sample = turn - plant.C[seen] @ x
        pipeline = [sample if k > 0 else np.zeros(3), *pipeline[:-1]]  # locked from the second step on
        result = isolate @ np.concatenate([xi, accelerated])
        xc = Ad @ xc + Bd @ np.concatenate([measured, np.zeros(3)])
        both = force + added
        x = A @ x + B @ both
        accelerated = plant.C[acceleration] @ x + plant.D[acceleration, :3] @ both
        force, xi = result[:3], result[3:]
        added, measured = law.output_map() @ xc, pipeline[-1]
        found.append(plant.C[rotation] @ x)
    return np.array(found)


def test_the_closed_loop_is_one_discrete_system(built_fmus):
    turn, steps = np.array([2e-7, -1e-7, 5e-8]), 1500  # rad
    target = np.array([1.0, *(0.5 * turn)])  # its norm is 1 within 1e-14
    system = without_sensors(read_system(LINE_OF_SIGHT, built_fmus)).with_parameters({
        **QUIET, "tracker.acquisition_time": 0.0,
        **{f"tracker.target_attitude.{k}": v for k, v in zip("wxyz", target.tolist(), strict=True)},
    })  # fmt: skip
    names = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")
    with Master(system, H) as master:
        master.initialise()
        samples = SampleObserver(master.columns, names, range(steps + 1))
        master.run(steps * H, [samples])
    found = samples.values(*names)
    expected = simulate_as_one(steps, turn, sampled_every=10, latency_steps=10, highpass_hz=0.02)
    assert np.abs(found[-1] - turn).max() < 0.3 * np.abs(turn).max()  # on its way to the target
    verify_claim(
        "model.line_of_sight_loop",
        claim="What plant, isolator, tracker and line-of-sight controller compute together",
        where="`ps-fmu run pointing`: all signals",
        reference="the closed loop as one discrete system, in one process, without FMUs",
        error=np.abs(found - expected) / np.abs(turn).max(),
        bound=1e-6,
        unit="of the turn",
    )


@pytest.fixture
def options(built_fmus, tmp_path):
    def make(duration_s, step_s, system=LINE_OF_SIGHT, **others):
        found = SCENARIOS["pointing"]
        folder = tmp_path / "out"
        made = RunOptions(found, system, folder, duration_s, step_s, fmus=built_fmus, progress=False, **others)
        return made.claim_output()

    return make


def test_the_loop_cut_open_is_the_closed_form(options):
    system = load_system(options(1.0, H), QUIET)
    loop = build_loop(system, np.zeros(3), H)
    shaking = replace(make_shaking(H, 0.01), half_period=10.0, settling=10.0, band=(0.5, 12.0))
    (found,) = measure_loop(system.structure, loop, shaking, {}, (1.0, 0.0, 0.0, 0.0), axes=("y",)).values()
    expected = find_margins(loop)[1]
    assert keeps_margins(found.margins)
    assert found.margins.phase_deg == pytest.approx(expected.phase_deg, abs=0.2)
    assert found.margins.gain_db == pytest.approx(expected.gain_db, abs=0.5)  # lines are 0.1 Hz apart
    decibels, degrees = found.deviation
    assert decibels < 0.2
    assert degrees < 1.0
    assert found.margins.crossover_hz == pytest.approx(expected.crossover_hz, rel=1e-3)


def test_margins_of_steps_are_those_in_continuous_time(options):
    """What ``analyse stability`` and ``run pointing`` state of one loop, by two linear models."""
    system = load_system(options(1.0, H), QUIET)
    stepped = find_loop_margins(Circuit(read_model(system.structure, H), True), POINTING).axes
    for found, expected in zip(stepped, find_margins(build_loop(system, np.zeros(3), H)), strict=True):
        assert found.gain_db == pytest.approx(expected.gain_db, abs=0.1)
        assert found.phase_deg == pytest.approx(expected.phase_deg, abs=0.1)


def find_free_pole(system, values, frequency_hz):
    """The slowest pole near a frequency in the motion after the target has jumped by 1e-7 rad, rad/s."""
    target = np.array([1.0, 0.5e-7, -0.3e-7, 0.4e-7])
    changed = system.with_parameters({
        **QUIET, **EXACT, "tracker.acquisition_time": 0.0, **values,
        **{f"tracker.target_attitude.{k}": v for k, v in zip("wxyz", target.tolist(), strict=True)},
    })  # fmt: skip
    names = tuple(f"plant.payload_rotation.{axis}" for axis in "xyz")
    with Master(changed, H) as master:
        master.initialise()
        samples = SampleObserver(master.columns, names, range(4000, 24001, 20))
        master.run(24.0, [samples])
    return slowest_mode(samples.values(*names), 20 * H, 24, (0.8 * frequency_hz, 1.2 * frequency_hz))


def test_the_loop_run_at_its_edge_decays_within_the_common_margins_and_grows_beyond(built_fmus):
    """Gain and delay of all axes alike, a little within and beyond, against the poles of the linear model, too."""
    system = read_system(LINE_OF_SIGHT, built_fmus)
    circuit = Circuit(read_model(system, H), True)
    margins = find_common_margins(
        lambda f: -circuit.cut_loop(POINTING, 2j * np.pi * f), circuit.frequencies[circuit.frequencies > 1e-3]
    )
    crossover = 1.25 * 10.0 ** (margins.gain_db / 20.0)  # Hz
    errors = []
    for share in (0.98, 1.02):
        for name, value, frequency in (
            ("pointing.loop.crossover_frequency", share * crossover, margins.gain_hz),
            ("pointing.delay", round(share * margins.delay_s, 3), margins.delay_hz),
        ):
            found = find_free_pole(system, {name: value}, frequency)
            assert (found.real > 0.0) == (share > 1.0)
            changed = Circuit(read_model(system.with_parameters({name: value}), H), True)
            assert (len(changed.unstable) > 0) == (share > 1.0)
            errors.append(abs(found - refine_pole(changed.characteristic, found)))
    verify_claim(
        "stability.edge",
        claim="Gain and delay common to all axes at which the line-of-sight loop is at its edge; its pole there",
        where="`ps-fmu run pointing`, `ps-fmu analyse stability`: margins of the loop as a whole",
        reference="free motion of the FMUs 2 % within and beyond each edge, by the eigensystem realisation",
        error=max(errors),
        bound=1e-3,
        unit="rad/s",
    )


@pytest.mark.parametrize(("step_s", "sample_s"), [(3e-4, 0.01), (1e-3, 0.003)])
def test_samples_of_the_tracker_that_do_not_fit_are_refused_before_the_runs(options, ssv, step_s, sample_s):
    given = options(3.0, step_s, parameters=(ssv({"tracker.sample_time": sample_s}),))
    text = rf"--step: .* \(tracker\.sample_time = {sample_s:g} s\), .*; got {step_s:g} s"
    with pytest.raises(OptionError, match=text):
        execute(given)
    assert not (given.output / "results.nc").exists()


def test_a_system_without_a_tracker_is_refused_by_name(options):
    wrong = options(3.0, H, system=LINE_OF_SIGHT.with_name("SystemStructure.ssd"))
    lines = r"does not fit the scenario pointing:\n- there is no component 'tracker'.*\n.* no component 'pointing'"
    with pytest.raises(OptionError, match=lines):
        execute(wrong)
