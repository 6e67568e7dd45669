"""Streams of random numbers: those of different components differ, even with equal seeds."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import combinations, product

import numpy as np
from scipy.stats import norm
from support.claims import verify_claim

from ps_fmu.actuators import voice_coil
from ps_fmu.actuators.voice_coil import WhiteNoise
from ps_fmu.disturbance import gaussian, multisine
from ps_fmu.disturbance.gaussian import GaussianNoise
from ps_fmu.disturbance.multisine import Multisine
from ps_fmu.numerics.normal import Stream, make_key, make_words
from ps_fmu.sensors import errors, line_of_sight
from ps_fmu.sensors.errors import NoiseModel, SensorNoise
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER

NUMBERS = range(3)


def seed(words):
    return np.random.SeedSequence(list(words))


def _list_keys() -> Iterator[tuple[int, ...]]:
    """Keys of all streams with equal seeds, of every length in use, blocks 0 to 2."""
    for stream, length in product(Stream, (1, 2, 3)):
        for rest in product(NUMBERS, repeat=length):
            yield make_key(stream, 1, *rest)


def test_no_two_keys_give_the_same_state():
    keys = list(_list_keys())
    states = {tuple(seed(make_words(key)).generate_state(4)) for key in keys}
    assert len(states) == len(keys)


def test_blocks_0_of_streams_are_independent():
    n = 4096
    drawn = [
        np.random.Generator(np.random.Philox(seed(make_words(make_key(stream, 1, *zeros))))).random(n)
        for stream in Stream
        for zeros in ((0,), (0, 0), (0, 0, 0))
    ]
    for one, other in combinations(drawn, 2):
        assert abs(np.corrcoef(one, other)[0, 1]) < 5.0 / np.sqrt(n)


def test_components_with_equal_seeds_share_no_key(monkeypatch):
    given = []

    def make(stream, *numbers):
        given.append(make_key(stream, *numbers))
        return given[-1]

    for module in (gaussian, multisine, voice_coil, line_of_sight, errors):
        monkeypatch.setattr(module, "make_key", make)
    times, band = np.array([0.0, 1.0]), np.array([0.1, 300.0])
    GaussianNoise(np.eye(6), band, 1)(times)
    Multisine(np.eye(6), band, 1)
    WhiteNoise(1, 3)(0, 1024)
    DEFAULT_TRACKER.noise(np.arange(3))
    for kind in (1, 2):
        SensorNoise(NoiseModel(1.0, 2.0, 0.5), 3, 1e-3, seed=1, kind=kind)(np.arange(600))
    assert {words[0] >> 8 for words in given} >= set(Stream) - {Stream.WHEEL, Stream.SENSOR_SPREAD}
    states = {tuple(seed(make_words(words)).generate_state(4)) for words in given}
    assert len(states) == len(set(given)) == len(given)


def test_streams_are_independent_at_every_lag():
    """Noise of all components with neighbouring seeds, and the seeds of two cases of a study: 72 series of 16384 rows.

    The cross-correlation of two independent series of n rows has a deviation of 1/sqrt(n) at each lag.  The noise on
    the bus has a band that leaves out a tenth of the rate.
    """
    n, rows = 2**14, []
    cases = [np.random.SeedSequence(4, spawn_key=(1, case)).generate_state(1) % 2**31 for case in (0, 1)]
    for seed_ in (1, 2, *(int(case[0]) for case in cases)):
        tracker = replace(DEFAULT_TRACKER, seed=seed_)
        rows += [
            *GaussianNoise(np.eye(6), np.array([1.0, 450.0]), seed_)(10.0 + np.arange(n) * 1e-3).T,
            *WhiteNoise(seed_, 3)(0, n).T,
            *tracker.noise(np.arange(n)).T,
            *SensorNoise(NoiseModel(1.0, 0.0, 0.0), 3, 1e-3, seed=seed_, kind=1)(np.arange(n)).T,
            *SensorNoise(NoiseModel(1.0, 0.0, 0.0), 3, 1e-3, seed=seed_, kind=2)(np.arange(n)).T,
        ]
    series = np.array(rows)
    series = (series - series.mean(axis=1, keepdims=True)) / series.std(axis=1, keepdims=True)
    spectra = np.fft.rfft(series, 2 * n, axis=1)
    largest = [
        np.abs(np.fft.irfft(spectra[k] * spectra[k + 1 :].conj(), axis=1)).max() / n for k in range(len(series) - 1)
    ]
    pairs = len(series) * (len(series) - 1) // 2
    verify_claim(
        "noise.independent_streams",
        claim="Noise of different axes, sensors, components, seeds and cases of a study is independent",
        where="`ps-fmu run`, `ps-fmu sweep`: what intervals and shares of sources rest on",
        reference="cross-correlation of 2556 pairs of series at all lags; chance exceeds the bound once in 1000",
        error=max(largest) / (norm.isf(0.5e-3 / (pairs * 2 * n)) / np.sqrt(0.9 * n)),
        bound=1.0,
        unit="of what chance allows",
    )
