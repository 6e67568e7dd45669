"""The budget against the FMUs: one source at a time, and all together."""

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ps_fmu.cosim import Master, read_parameters, read_system
from ps_fmu.disturbance import multisine_lines, psd_at_origin
from ps_fmu.interface.linear_system import Circuit, read_model
from ps_fmu.pointing import RelativeError
from ps_fmu.pointing.budget import make_budget
from ps_fmu.results.observers.sampler import SampleObserver
from ps_fmu.trades.budget.results import find_edges, list_sources, select_signals

SYSTEM = Path(__file__).parents[2] / "system"
STEP, ROW = 1e-4, 1e-3  # s: of communication, between the rows that are kept
SETTLING, PERIOD = 4.0, 10.0  # s
SEED = 5
INDEX = RelativeError(1.0, "uniform")
SIGNALS = tuple(f"payload_rotation.{axis}" for axis in "xyz")
#: Levels at which each source matters.  Much damping and a high corner: a record of 10 s has many independent samples.
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
    "disturbance.wheel_1.scale": 3e4,
    "sensors.seed": SEED,
    "sensors.accelerometer.bias_instability": 0.0,
    "sensors.accelerometer.resolution": 0.0,  # rounding is not linear
    "coils.driver.seed": SEED,
    "coils.driver.current_resolution": 0.0,
}
#: What switches the sources on; all are off unless they are named.
SWITCHES = {
    "noise": ("disturbance.noise.enabled", False, True),
    "wheel": ("disturbance.wheel_1.enabled", False, True),
    "accelerometers": ("sensors.accelerometer.noise_density", 0.0, 2e-5),
    "coils": ("coils.driver.noise", 0.0, 1e-4),
}


def make_values(on):
    return VALUES | {name: high if source in on else low for source, (name, low, high) in SWITCHES.items()}


def run(system, on):
    """Rotation of the payload with some sources on, (rows, 3), rad: a period and a window more."""
    first, stride = round(SETTLING / STEP), round(ROW / STEP)
    rows = first + stride * np.arange(round((PERIOD + INDEX.window) / ROW) + 1)
    names = [f"plant.{name}" for name in SIGNALS]
    with Master(system.with_parameters(make_values(on)), STEP) as master:
        master.initialise()
        samples = SampleObserver(master.columns, names, rows.tolist())
        master.run(rows[-1] * STEP, [samples])
    return samples.values(*names)


def measure(record):
    """Mean square of the index over windows that begin within a period, (3,), rad2."""
    found = INDEX.of_record(record[:-1], ROW, stride=10)
    return found.rms**2


@pytest.fixture(scope="module")
def records(built_fmus):
    """With each source alone, and with all."""
    system = read_system(SYSTEM / "Instrument.ssd", built_fmus)
    cases = [*((name,) for name in SWITCHES), tuple(SWITCHES)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        found = pool.map(lambda on: run(system, on), cases)
        return dict(zip([*SWITCHES, "all"], found, strict=True))


@pytest.fixture(scope="module")
def circuit(built_fmus):
    system = read_system(SYSTEM / "Instrument.ssd", built_fmus).with_parameters(make_values(SWITCHES))
    return Circuit(read_model(system), True)


@pytest.fixture(scope="module")
def sources(circuit):
    """By what switches them, the noise as the lines of this seed; and the noise by its density."""
    modes, found = list_sources(circuit, SIGNALS, points=600)
    noise = next(source for source in found if source.name == "noise")
    disturbance = circuit.model.disturbance
    at_origin = psd_at_origin(noise.spectrum, disturbance.bus.com_B)
    frequency, wrench = multisine_lines(at_origin, disturbance.kinds["noise"].band, SEED, PERIOD)
    ways = circuit.respond(frequency, SIGNALS, ["DisturbanceSource"]).parts
    power = 0.5 * wrench[:, :, None] * wrench[:, None, :].conj()
    of_seed = replace(noise, frequency=frequency, response=ways, spectrum=power, lines=True)
    wheel = [source for source in found if source.name.startswith("wheel 1")]
    rest = {source.name: [source] for source in found if source.name in ("accelerometers", "coils")}
    return modes, {"noise": [of_seed], "wheel": wheel, **rest}, noise


def budget(sources, axis, modes):
    own = [select_signals(source, [axis]) for source in sources]
    return make_budget(INDEX, own, find_edges(0.5 / STEP), step=STEP, modes=modes)


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


def spread_of_cross_terms(random, wheel, axis):
    """Of twice the mean products of independent random sources, and of the wheel's lines with them."""
    f = random[-1].frequency
    densities = np.array([weigh(source, axis, f) for source in random])
    total = float(np.trapezoid(densities.sum(axis=0) ** 2 - (densities**2).sum(axis=0), f)) / PERIOD
    for source in wheel:
        power = select_signals(source, [axis]).density() * INDEX.weight(source.frequency, STEP)
        total += 2.0 * float(power[0] * sum(weigh(one, axis, source.frequency)[0] for one in random)) / PERIOD
    return total


def find_coherence(found):
    """Largest cross terms of force and torque of the same order, whose phases are fixed in a run, rad2."""
    part = dict(zip(found.channels, found.by_channel, strict=True))
    pairs = [(name, name.replace("force", "torque")) for name in part if "force" in name]
    return sum(2.0 * np.sqrt(part[force] * part[torque]) for force, torque in pairs if torque in part)


def test_the_answer_to_all_is_the_sum_of_the_answers(records):
    """Switching sources off takes away what they do and nothing else."""
    together = sum(records[name] for name in SWITCHES)
    assert np.abs(together - records["all"]).max() < 1e-7 * np.abs(records["all"]).max()


@pytest.mark.parametrize("axis", range(3))
def test_the_noise_alone(records, sources, axis):
    """The lines of this seed: no scatter, 3 % for transients and for what the multisine is between its lines."""
    found = budget(sources[1]["noise"], axis, sources[0])
    assert measure(records["noise"])[axis] == pytest.approx(found.variance, rel=0.03, abs=0.0)


@pytest.mark.parametrize("axis", range(3))
def test_a_wheel_alone(records, sources, axis):
    """Within the cross terms of force and torque, and 3 % for lines that are no multiples of 0.1 Hz."""
    found = budget(sources[1]["wheel"], axis, sources[0])
    coherent = find_coherence(found)
    assert 0.0 < coherent < 0.7 * found.variance
    assert abs(measure(records["wheel"])[axis] - found.variance) < coherent + 0.03 * found.variance
    assert found.dominant()[0] in ("wheel 1 force 1.01", "wheel 1 torque 1.01")


@pytest.mark.parametrize("name", ["accelerometers", "coils"])
def test_noise_of_the_instrument_alone(records, sources, name):
    """Each axis within three standard deviations of the mean square of a record as long, and 2 %."""
    for axis, measured in enumerate(measure(records[name])):
        expected = budget(sources[1][name], axis, sources[0]).variance
        scatter = np.sqrt(spread(sources[1][name][0], axis))
        assert scatter < 0.3 * expected
        assert abs(measured - expected) < 3.0 * scatter + 0.02 * expected


@pytest.mark.parametrize("axis", range(3))
def test_the_sum_of_variances_meets_the_run_with_all_on(records, sources, axis):
    """Measured of each alone, within the scatter of cross terms; in closed form, within that of each, too."""
    modes, own, noise = sources
    alone = {name: budget(each, axis, modes).variance for name, each in own.items()}
    expected = budget([source for each in own.values() for source in each], axis, modes).variance
    assert expected == pytest.approx(sum(alone.values()), rel=1e-9, abs=0.0)
    assert min(alone.values()) > 0.001 * expected  # each of them is seen
    random = [noise, *own["coils"], *own["accelerometers"]]
    cross = spread_of_cross_terms(random, own["wheel"], axis)
    measured = measure(records["all"])[axis]
    separate = sum(measure(records[name])[axis] for name in SWITCHES)
    assert np.sqrt(cross) < 0.2 * expected
    assert abs(measured - separate) < 3.0 * np.sqrt(cross)
    scatter = np.sqrt(cross + sum(spread(source, axis) for source in random[1:]))
    coherent = find_coherence(budget(own["wheel"], axis, modes))
    assert abs(measured - expected) < 3.0 * scatter + coherent + 0.03 * expected
