"""The budget against the FMUs: one source at a time, and all together."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.cosim import Master, read_parameters, read_system
from ps_fmu.disturbance.recording import HEADER
from ps_fmu.interface.linear_system import Circuit
from ps_fmu.interface.system_model import read_model
from ps_fmu.pointing import AbsoluteError, RelativeError
from ps_fmu.pointing.budget import make_budget
from ps_fmu.results.observers.sampler import SampleObserver
from ps_fmu.theory.sampled import WRENCH, connect, make_plant_block
from ps_fmu.trades.budget.results import find_edges, list_sources, select_signals

SYSTEM = Path(__file__).parents[2] / "system"
STEP, ROW = 1e-4, 1e-3  # s: of communication, between the rows that are kept
SETTLING, PERIOD = 4.0, 10.0  # s
SEED = 5
INDEX = RelativeError(1.0, "uniform")
SIGNALS = tuple(f"payload_rotation.{axis}" for axis in "xyz")
#: Levels at which each source matters.  Much damping and a high-pass of a high frequency: 10 s have many independent
#: samples.
VALUES = {
    **dict(read_parameters(SYSTEM / "parameters" / "large_damping.ssv")),
    "isolator.filters.highpass_frequency": 1.0,  # Hz
    "disturbance.seed": SEED,
    "disturbance.noise.scale": 0.2,
    "disturbance.noise.multisine": True,  # over a period its mean square has no scatter
    "disturbance.noise.period": PERIOD,
    "disturbance.noise.band.min": 0.3,  # Hz
    "disturbance.noise.band.max": 500.0,  # Hz
    "disturbance.wheel_1.initial_speed": 40.0,  # rad/s
    "disturbance.wheel_1.final_speed": 40.0,  # rad/s
    "disturbance.wheel_1.static_imbalance": 6.5e-3,  # kg.m
    "disturbance.wheel_1.dynamic_imbalance": 1.9e-4,  # kg.m2
    "disturbance.recording.repeat": True,
    "disturbance.tone_1.frequency": 3.0,  # Hz
    "disturbance.tone_2.frequency": 3.0,  # Hz
    "disturbance.tone_2.phase": 2.0,  # rad
    "sensors.seed": SEED,
    "sensors.accelerometer.bias_instability": 0.0,
    "sensors.accelerometer.resolution": 0.0,  # rounding is not linear
    "coils.driver.seed": SEED,
    "coils.driver.current_resolution": 0.0,
}
#: What switches the sources on; all are off, or zero, unless they are named.
SWITCHES = {
    "noise": {"disturbance.noise.enabled": True},
    "wheel": {"disturbance.wheel_1.enabled": True},
    "recording": {"disturbance.recording.scale": 1.0},
    "sines": {"disturbance.tone_1.force.y": 0.3, "disturbance.tone_2.torque.x": 0.1},
    "accelerometers": {"sensors.accelerometer.noise_density": 2e-5},
    "coils": {"coils.driver.noise": 1e-4},
}
TOGETHER = ("noise", "wheel", "accelerometers", "coils")  # the recording's lines lie on those of the noise


def write_recording(path):
    """A period of 40 sines that begins without momentum: each force is largest at first, when its impulse is zero."""
    random, time = np.random.default_rng(8), np.arange(0.0, PERIOD + 1e-9, 1e-3)
    number = random.integers(4, 600, 40)  # in the period
    size = random.normal(size=(40, 6)) * np.array([1.0, 1.0, 1.0, 0.5, 0.5, 0.5])  # N, N.m
    wrench = np.cos(2.0 * np.pi * np.outer(time / PERIOD, number)) @ size
    write_rows(path, time, wrench)


def write_rows(path, time, wrench):
    np.savetxt(path, np.column_stack([time, wrench]), delimiter=",", header=",".join(HEADER), comments="")


def make_values(on):
    values = dict(VALUES)
    for source, own in SWITCHES.items():
        values |= own if source in on else {name: type(value)(0) for name, value in own.items()}
    return values


def simulate(system, start, end):
    """Rotation of the payload between two times, s, (rows, 3), rad."""
    rows = round(start / STEP) + round(ROW / STEP) * np.arange(round((end - start) / ROW) + 1)
    names = [f"plant.{name}" for name in SIGNALS]
    with Master(system, STEP) as master:
        master.initialise()
        samples = SampleObserver(master.columns, names, rows.tolist())
        master.run(rows[-1] * STEP, [samples])
    return samples.values(*names)


def measure(record):
    """Mean square of the index over windows that begin within a period, (3,), rad2."""
    found = INDEX.of_record(record[:-1], ROW, stride=10)
    return found.rms**2


@pytest.fixture(scope="module")
def system(built_fmus, tmp_path_factory):
    path = tmp_path_factory.mktemp("recording") / "measured.csv"
    write_recording(path)
    return read_system(SYSTEM / "Instrument.ssd", built_fmus).with_parameters({"disturbance.recording.path": str(path)})


@pytest.fixture(scope="module")
def records(system):
    """With each source alone, and with all."""
    cases = [*((name,) for name in SWITCHES), TOGETHER]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        end = SETTLING + PERIOD + INDEX.window
        found = pool.map(lambda on: simulate(system.with_parameters(make_values(on)), SETTLING, end), cases)
        return dict(zip([*SWITCHES, "all"], found, strict=True))


@pytest.fixture(scope="module")
def circuit(system):
    return Circuit(read_model(system.with_parameters(make_values(SWITCHES))), True)


@pytest.fixture(scope="module")
def sources(circuit):
    """By what switches them."""
    found = list_sources(circuit, SIGNALS, points=600)[1]
    return {name: [s for s in found if s.name.startswith(name.removesuffix("s"))] for name in SWITCHES}


def budget(sources, axis):
    own = [select_signals(source, [axis]) for source in sources]
    return make_budget(INDEX, own, find_edges(0.5 / STEP), step=STEP)


def weigh(source, axis, frequency):
    """Density of the index by a source, rad2/Hz, at frequencies (n,)."""
    own = select_signals(source, [axis])
    found = np.interp(frequency, own.frequency, own.density(), left=0.0, right=0.0)
    return INDEX.weight(frequency, STEP) * found


def spread(source, axis):
    """Variance, rad4, of the mean square of a random source over the period: integral of S^2 over T.

    J. S. Bendat, A. G. Piersol, Random Data, 8.2, for one-sided densities S.
    """
    f = source.frequency
    return float(np.trapezoid(weigh(source, axis, f) ** 2, f)) / PERIOD


def spread_of_cross_terms(random, lines, axis):
    """Variance, rad4, of twice the mean products of independent random sources, and of lines with them."""
    f = random[-1].frequency
    densities = np.array([weigh(source, axis, f) for source in random])
    total = float(np.trapezoid(densities.sum(axis=0) ** 2 - (densities**2).sum(axis=0), f)) / PERIOD
    for source in lines:
        power = select_signals(source, [axis]).density() * INDEX.weight(source.frequency, STEP)
        beside = sum(weigh(one, axis, source.frequency) for one in random)
        total += 2.0 * float(power @ beside) / PERIOD
    return total


def answer_to_wheel(circuit, axis, seeds):
    """Mean squares (seeds,), rad2, of the index by the wheel with the phases that its seeds draw."""
    shared = circuit.model.disturbance
    wheel = shared.kinds["wheels"][0]
    sources = [wheel.make_source(replace(shared, seed=seed), 1) for seed in seeds]
    orders = sources[0].orders
    frequency = np.unique(orders) * wheel.initial_speed / (2.0 * np.pi)
    response = circuit.respond(frequency, SIGNALS, ["DisturbanceSource"])[:, axis]
    same = np.unique(orders)[:, None] == orders
    wrench = np.array([same @ source.amplitudes(wheel.initial_speed) for source in sources])
    answer = np.einsum("nc,snc->ns", response, wrench)
    return INDEX.variance_of_lines(frequency, answer, step=STEP)


def test_the_answer_to_all_is_the_sum_of_the_answers(records):
    """Switching sources off takes away what they do and nothing else."""
    together = sum(records[name] for name in TOGETHER)
    assert np.abs(together - records["all"]).max() < 1e-7 * np.abs(records["all"]).max()


@pytest.mark.parametrize("name", ["noise", "recording", "sines"])
@pytest.mark.parametrize("axis", range(3))
def test_lines_alone(records, sources, name, axis):
    """Of the multisine's seed, a recording that repeats, two sines of one frequency with their phases: no scatter.

    3 % for transients, and for what a multisine is between its lines.
    """
    found = budget(sources[name], axis)
    assert found.worst_variance == pytest.approx(found.variance, rel=1e-12)
    verify_claim(
        "budget.lines_by_source",
        claim="Variance by the noise as a multisine, by a recording that repeats, by sines of one frequency",
        where="`ps-fmu analyse budget`: share of each source",
        reference="runs of the FMUs of Instrument.ssd with this source alone, over a period",
        error=abs(measure(records[name])[axis] / found.variance - 1.0),
        bound=0.03,
    )


@pytest.mark.parametrize("axis", range(3))
def test_a_wheel_alone(circuit, records, sources, axis):
    """With the phases of its seed 3 % for lines that are no multiples of 0.1 Hz; below the worst phases."""
    found, measured = budget(sources["wheel"], axis), measure(records["wheel"])[axis]
    assert measured < 1.03 * found.worst_variance
    assert 1.05 * found.variance < found.worst_variance < 2.0 * found.variance
    assert found.dominant()[0] in ("wheel 1 force 1", "wheel 1 torque 1")
    verify_claim(
        "budget.wheel_with_its_phases",
        claim="Variance by the lines of a wheel, with given phases",
        where="`ps-fmu analyse budget`: share of each source",
        reference="run of the FMUs of Instrument.ssd with the wheel alone",
        error=abs(measured / float(answer_to_wheel(circuit, axis, [SEED])[0]) - 1.0),
        bound=0.03,
    )


@pytest.mark.parametrize("axis", range(3))
def test_a_wheel_with_all_seeds(circuit, sources, axis):
    """The budget is the mean over the seeds, within its scatter, and the worst phases are above all of them."""
    found, squares = budget(sources["wheel"], axis), answer_to_wheel(circuit, axis, range(500))
    assert 0.97 * found.worst_variance < squares.max() < found.worst_variance
    verify_claim(
        "budget.wheel_on_average",
        claim="RMS by a wheel, a mean over its initial phases",
        where="`ps-fmu analyse budget`: RMS and shares of wheels",
        reference="mean square with the phases that 500 seeds draw",
        error=abs(squares.mean() - found.variance) / (squares.std() / np.sqrt(500)),
        bound=3.0,
        unit="standard deviations",
    )


@pytest.mark.parametrize("name", ["accelerometers", "coils"])
def test_noise_of_the_instrument_alone(records, sources, name):
    """Each axis within three standard deviations of the mean square of a record as long, and 2 %."""
    for axis, measured in enumerate(measure(records[name])):
        expected = budget(sources[name], axis).variance
        scatter = np.sqrt(spread(sources[name][0], axis))
        assert scatter < 0.3 * expected
        verify_claim(
            "budget.noise_of_the_instrument",
            claim="Variance by accelerometers, by voice coils",
            where="`ps-fmu analyse budget`: share of each source",
            reference="runs of the FMUs of Instrument.ssd with this source alone; scatter of a record of 10 s, and 2 %",
            error=abs(measured - expected) / (scatter + 0.007 * expected),
            bound=3.0,
            unit="standard deviations",
        )


@pytest.mark.parametrize("axis", range(3))
def test_the_sum_of_variances_meets_the_run_with_all_on(circuit, records, sources, axis):
    """Measured of each alone, within the scatter of cross terms; in closed form, within that of each, too."""
    own = {name: sources[name] for name in TOGETHER}
    alone = {name: budget(each, axis).variance for name, each in own.items()}
    expected = budget([source for each in own.values() for source in each], axis).variance
    assert expected == pytest.approx(sum(alone.values()), rel=1e-9, abs=0.0)
    assert min(alone.values()) > 0.001 * expected  # each of them is seen
    random, lines = [*own["coils"], *own["accelerometers"]], [*own["noise"], *own["wheel"]]
    cross = spread_of_cross_terms(random, lines, axis)
    measured = measure(records["all"])[axis]
    separate = sum(measure(records[name])[axis] for name in TOGETHER)
    assert np.sqrt(cross) < 0.2 * expected
    assert abs(measured - separate) < 3.0 * np.sqrt(cross) + 0.02 * expected
    scatter = np.sqrt(cross + sum(spread(source, axis) for source in random))
    of_seed = expected - alone["wheel"] + float(answer_to_wheel(circuit, axis, [SEED])[0])
    assert abs(measured - of_seed) < 3.0 * scatter + 0.03 * expected


def test_a_recording_that_ends(system, tmp_path):
    """Noise and a sine over 40 s, faded in and out: each axis as in the run of 32 s between, within its scatter."""
    random, duration, time = np.random.default_rng(2), 40.0, np.arange(0.0, 40.0 + 1e-9, 1e-3)
    spectra, frequency = np.fft.rfft(random.normal(size=(len(time), 6)), axis=0), np.fft.rfftfreq(len(time), 1e-3)
    size = np.where((frequency > 0.5) & (frequency < 60.0), 1.0 / (1.0 + frequency / 5.0), 0.0)
    wrench = np.fft.irfft(spectra * size[:, None], len(time), axis=0) * np.array([20.0, 20.0, 20.0, 5.0, 5.0, 5.0])
    wrench[:, 2] += np.cos(2.0 * np.pi * 7.3 * time)
    fade = np.clip(np.minimum(time, duration - time) / 3.0, 0.0, 1.0)[:, None]
    path = tmp_path / "measured.csv"
    write_rows(path, time, wrench * fade * fade * (3.0 - 2.0 * fade))
    own = {"disturbance.recording.path": str(path), "disturbance.recording.repeat": False}
    measured = system.with_parameters(make_values(["recording"]) | own)
    found = list_sources(Circuit(read_model(measured), True), SIGNALS, points=600)[1]
    source = next(source for source in found if source.name == "recording")
    expected = [budget([source], axis).variance for axis in range(3)]
    verify_claim(
        "budget.recording",
        claim="Variance by a recording that does not repeat",
        where="`ps-fmu analyse budget` with `disturbance.recording.path`",
        reference="run of the FMUs of Instrument.ssd with a recording of 40 s; its Welch spectrum weights the middle",
        error=np.abs(measure(simulate(measured, 4.0, 36.0)) / expected - 1.0),
        bound=0.15,
    )


def test_gaussian_noise_over_hours(built_fmus):
    """The passive image point in time: the generator's noise through plant and steps of 0.05 s, as long as it takes.

    A budget of a rectangle from 0.1 Hz on would be off by 16 %.
    """
    h, duration = 0.05, 40_000.0 if os.environ.get("PS_FMU_SOAK") else 8000.0  # s
    quiet = {"disturbance.noise.band.max": 5.0, "disturbance.seed": SEED}
    system = read_system(SYSTEM / "SystemStructure.ssd", built_fmus).with_parameters(quiet)
    circuit = Circuit(read_model(system, h), False)
    source = list_sources(circuit, ("los.x", "los.y"))[1][0]
    expected = make_budget(AbsoluteError(), [source], find_edges(0.5 / h), step=h).variance
    scatter = np.sqrt(float(np.trapezoid(source.density() ** 2, source.frequency)) / duration)
    blocks, inputs = {"plant": make_plant_block(circuit.model.loop.model, h)}, [f"plant.{name}" for name in WRENCH]
    model = connect(blocks, [], inputs, ["plant.los.x", "plant.los.y"], h)
    state, square, settled = np.zeros(len(model.A)), 0.0, round(200.0 / h)
    noise = circuit.model.disturbance.kinds["noise"].make_source(circuit.model.disturbance, 1)
    rows = settled + round(duration / h)
    for first in range(0, rows, 4000):
        for k, wrench in enumerate(noise(h * np.arange(first, min(first + 4000, rows))), first):
            if k >= settled:
                image = model.C @ state
                square += float(image @ image) * h / duration
            state = state + h * (model.A @ state + model.B @ wrench)
    assert 3.0 * scatter < 0.3 * expected
    verify_claim(
        "budget.gaussian_noise",
        claim="RMS of the passive image point under the Gaussian noise",
        where="`ps-fmu analyse budget`: RMS",
        reference="the generator's noise through the plant, step by step, over 8000 s",
        error=abs(square - expected) / scatter,
        bound=3.0,
        unit="standard deviations",
    )
