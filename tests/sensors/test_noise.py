"""Noise of sensors: Allan deviation and spectrum against the model, and a function of the sample's number alone."""

from functools import cache

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.numerics.library import GRIDS, PLACES, PROCESSES, WHITE
from ps_fmu.numerics.normal import Stream, make_key
from ps_fmu.sensors.errors import CORRELATION_TIMES, DRIFT_INTERVAL, NoiseModel, SensorNoise

SENSORS = 30
INTERVAL = 0.01  # s, a tenth of the shortest correlation time
SAMPLES = 60_000


def allan_variance(record, interval, tau):
    """Over all sensors of a record (n, sensors): the variance, and its relative standard error."""
    width = round(tau / interval)
    means = record[: len(record) // width * width].reshape(-1, width, record.shape[1]).mean(axis=1)
    of_each = 0.5 * (np.diff(means, axis=0) ** 2).mean(axis=0)
    return of_each.mean(), of_each.std() / of_each.mean() / np.sqrt(len(of_each) - 1)


def expected_variance(model, tau):
    """Allan variance over averaging times (n,), s: N^2/t, Gauss-Markov processes, K^2 t/3."""
    ratio = CORRELATION_TIMES / tau[:, None]
    ends = 3.0 - 4.0 * np.exp(-1.0 / ratio) + np.exp(-2.0 / ratio)
    flicker = (2.0 * model.variance * ratio * (1.0 - 0.5 * ratio * ends)).sum(axis=-1)
    return 0.5 * model.density**2 / tau + flicker + model.random_walk**2 * tau / 3.0


@pytest.mark.parametrize(
    "model",
    [NoiseModel(1.0, 0.0, 0.0), NoiseModel(0.0, 1.0, 0.0), NoiseModel(0.0, 0.0, 1.0), NoiseModel(2.0, 1.0, 0.1)],
    ids=["white", "flicker", "walk", "all"],
)
def test_allan_deviation_is_that_of_the_model(model):
    """Within four standard errors, which are 0.3 to 12 % of the variance."""
    record = SensorNoise(model, SENSORS, INTERVAL, seed=3, kind=1)(np.arange(SAMPLES))
    off = []
    for tau in (0.1, 1.0, 10.0, 50.0):
        found, error = allan_variance(record, INTERVAL, tau)
        assert error < 0.15
        off.append(abs(found / expected_variance(model, np.array([tau]))[0] - 1.0) / error)
    verify_claim(
        "noise.allan",
        claim="Allan deviation of sensor noise: white, flicker, random walk and all",
        where="`system/InertialSensors.ssd`, `Instrument.ssd`: accelerometers and rate sensors",
        reference="closed form of IEEE Std 952, at four averaging times",
        error=max(off),
        bound=4.0,
        unit="standard errors",
    )


def test_spectrum_is_that_of_the_model():
    """Periodograms with a Hann window, averaged over sensors and decades."""
    model = NoiseModel(1.0, 2.0, 0.0)
    record = SensorNoise(model, SENSORS, 1e-3, seed=5, kind=2)(np.arange(2**16))
    window = np.hanning(2**16)
    lines = np.fft.rfft((record - record.mean(axis=0)) * window[:, None], axis=0)
    density = 2e-3 * (np.abs(lines) ** 2).mean(axis=1) / (window**2).sum()
    frequency = np.fft.rfftfreq(2**16, 1e-3)
    off = []
    for low, high in ((0.1, 1.0), (1.0, 10.0), (10.0, 400.0)):
        band = (frequency > low) & (frequency < high)
        off.append(abs(density[band].mean() / model.spectrum(frequency[band]).mean() - 1.0))
    verify_claim(
        "noise.sensor_spectrum",
        claim="Density of sensor noise, which closed forms and budgets use",
        where="`ps-fmu analyse sensors`, `analyse budget`",
        reference="periodograms of the generator's noise, in three bands",
        error=max(off),
        bound=0.06,
    )


def test_closed_forms():
    tau = np.geomspace(3.0, 100.0, 200)  # s
    plateau = np.sqrt(2.0 * np.log(2.0) / np.pi)  # of the Allan deviation over B: IEEE Std 952-1997, annex C
    assert np.sqrt(expected_variance(NoiseModel(0.0, 1.0, 0.0), tau)) == pytest.approx(plateau, rel=0.08)
    f = np.geomspace(1e-3, 1.0, 50)  # Hz
    assert NoiseModel(0.0, 1.0, 0.0).spectrum(f) * np.pi * f == pytest.approx(1.0, rel=0.13)


@pytest.mark.parametrize("interval", [1e-4, 3e-3, 2.0])
def test_a_sample_does_not_depend_on_how_it_is_asked_for(interval):
    def make(sensors=3, seed=1):
        return SensorNoise(NoiseModel(1.0, 2.0, 0.5), sensors, interval, seed, kind=0)

    whole = make()(np.arange(3000))
    pieces = make()
    backwards = [pieces(np.arange(k, k + 100)) for k in range(2900, -100, -100)]
    np.testing.assert_array_equal(np.concatenate(backwards[::-1]), whole)
    np.testing.assert_array_equal(make()(np.arange(7, 3000, 13)), whole[7::13])
    np.testing.assert_array_equal(make(sensors=5)(np.arange(3000))[:, :3], whole)
    assert (make(seed=2)(np.arange(3000)) != whole).all()
    assert np.abs(np.corrcoef(whole.T) - np.eye(3)).max() < (0.2 if interval < 1.0 else 1.0)


def test_sample_of_any_time():
    """Decades at 10 kHz, at once; neighbours there are alike, also across a place where blocks of all grids meet."""
    late = 2 * 64**6 * 100
    drift = SensorNoise(NoiseModel(0.0, 1.0, 0.0), 200, 1e-4, 1, 0)(np.arange(late - 200, late + 200, 100))
    assert drift.std() == pytest.approx(np.sqrt(5.0 * NoiseModel(0.0, 1.0, 0.0).variance), rel=0.2)
    assert np.abs(np.diff(drift, axis=0)).max() < 0.5 * np.abs(drift).max()


def draw(stream, key, sensors, columns):
    """Normal numbers (sensors, columns) by Box-Muller: cosines, then sines."""
    random = np.random.Generator(np.random.Philox(np.random.SeedSequence(make_key(stream, *key))))
    u, v = random.random((sensors, 2, columns // 2)).swapaxes(0, 1)
    radius = np.sqrt(-2.0 * np.log1p(-u))
    return np.concatenate([radius * np.cos(2.0 * np.pi * v), radius * np.sin(2.0 * np.pi * v)], axis=1)


class Drift:
    """Paths of the processes between the places of the grid above, which a path of that grid has."""

    def __init__(self, model, sensors, interval, key):
        self.model, self.sensors, self.interval, self.key = model, sensors, interval, key
        self.find = cache(self.find)

    def constants(self, grid):
        interval = self.interval * PLACES**grid
        c = np.append(np.exp(-interval / CORRELATION_TIMES), 1.0)[:, None]
        s = np.sqrt(self.model.variance) * np.sqrt(1.0 - c**2)
        s[-1] = self.model.random_walk * np.sqrt(interval)
        grown = [sum(c ** (2 * j) for j in range(k)) for k in range(PLACES + 1)]  # variance of a path from 0, over s^2
        return c, s, grown

    def place(self, grid, number):
        if grid < GRIDS:
            return self.find(grid, number // PLACES)[number % PLACES]
        c, s, grown = self.constants(grid - 1)
        x = np.zeros((PROCESSES, self.sensors))
        for k in range(number + 1):
            normal = draw(Stream.SENSOR_DRIFT, (*self.key, 1, k), self.sensors, PROCESSES).T
            first = np.append(np.full(PROCESSES - 1, np.sqrt(self.model.variance)), 0.0)[:, None]
            x = c**PLACES * x + s * np.sqrt(grown[-1]) * normal if k else first * normal
        return x

    def find(self, grid, block):
        """(PLACES + 1, PROCESSES, sensors)"""
        c, s, grown = self.constants(grid)
        normal = draw(Stream.SENSOR_DRIFT, (*self.key, 2 + grid, block), self.sensors, PROCESSES * PLACES)
        path = [self.place(grid + 1, block)]
        for k in range(PLACES):
            path.append(c * path[-1] + s * normal.reshape(self.sensors, PROCESSES, PLACES)[:, :, k].T)
        missing = self.place(grid + 1, block + 1) - path[-1]
        return [x + c ** (PLACES - k) * grown[k] / grown[-1] * missing for k, x in enumerate(path)]


def find_errors(model, sensors, interval, seed, kind, index):
    """White noise of each sample, and the drift, linear between the places of its grid."""
    stride = round(min(max(1.0, DRIFT_INTERVAL / interval), 2.0**53))
    drift = Drift(model, sensors, stride * interval, (seed, kind))
    errors = []
    for number in index.tolist():
        block, k = divmod(number, WHITE)
        white = draw(Stream.SENSOR_WHITE, (seed, kind, block % 2**32), sensors, WHITE)[:, k]
        place, rest = divmod(number, stride)
        path = drift.find(0, place // PLACES)
        before, after = (path[place % PLACES + k].sum(axis=0) for k in (0, 1))
        errors.append(white * model.density / np.sqrt(2.0 * interval) + before + rest / stride * (after - before))
    return np.array(errors)


@pytest.mark.parametrize("interval", [1e-3, 7e-3, 1e-20, 1e-300, 5e-324])
def test_errors_are_those_of_the_formula(interval):
    """The three last: how many samples lie between two values of the drift is more than a whole number can say."""
    given = NoiseModel(1e-3, 1e-4, 1e-5), 3, interval, 1, 0
    index = np.array([0, 1, 127, 128, 255, 256, 300, 5000, 10**13 if interval < 1e-3 else 10**5])
    found = SensorNoise(*given)(index)
    np.testing.assert_allclose(found, find_errors(*given, index), rtol=1e-9, atol=1e-13 * np.abs(found).max())
