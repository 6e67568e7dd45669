"""Indices from covariances: against closed forms, against explicit sums over the window, and against spectra."""

from fractions import Fraction

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.pointing import (
    AbsoluteError,
    DriftError,
    LinearProcess,
    MeanError,
    RelativeError,
    ResidualJitter,
    Smear,
)

STEP = 0.01  # s
SAMPLES = 30
WINDOW = SAMPLES * STEP
EXACT = 1e-9
UNIFORM, END = RelativeError(WINDOW, "uniform"), RelativeError(WINDOW, "end")
OFFSET_FREE = UNIFORM, END, DriftError(WINDOW, 0.5), DriftError(WINDOW, 0.1), Smear(WINDOW), ResidualJitter(WINDOW)
ALL = AbsoluteError(), MeanError(WINDOW), *OFFSET_FREE


def identity(index):
    return f"{index.symbol} {getattr(index, 'at', getattr(index, 'separation', ''))}"


@pytest.fixture(scope="module")
def process():
    """Two outputs of three states, a resonance among them, with output noise."""
    A = np.array([[0.95, 0.2, 0.0], [-0.12, 0.93, 0.05], [0.0, 0.0, 0.7]])
    C = np.array([[1.0, 0.3, 0.0], [0.2, 1.0, -0.5]])
    noise = np.array([[1.0, 0.3, 0.1], [0.3, 0.5, 0.0], [0.1, 0.0, 0.8]])
    return LinearProcess(A, C, noise, STEP, np.array([[0.3, 0.1], [0.1, 0.2]]))


def kernels(index):
    """The index as rows over its samples, each with its probability, built from its definition in words."""
    n, count = SAMPLES, index.count(STEP)
    mean, unit = np.full(n, 1.0 / n), np.eye(n)
    centred = np.arange(n) - (n - 1) / 2.0
    trend = np.outer(centred, centred) / (centred @ centred)
    flat = np.full((n, n), 1.0 / n)
    match index.symbol, getattr(index, "at", None):
        case "APE", _:
            return np.ones((1, 1))
        case "MPE", _:
            return mean[None]
        case "RPE", "uniform":
            return (unit - flat) / np.sqrt(n)
        case "RPE", "end":
            return (unit - flat)[-1:]
        case "PDE", _:
            apart = count - n
            return (np.append(np.zeros(apart), mean) - np.append(mean, np.zeros(apart)))[None]
        case "smear", _:
            return trend / np.sqrt(n)
        case "jitter", _:
            return (unit - flat - trend) / np.sqrt(n)
    raise AssertionError(index)


@pytest.mark.parametrize("index", ALL, ids=identity)
def test_the_sum_over_the_window_written_out(process, index):
    rows = kernels(index)
    count = rows.shape[1]
    R = process.autocovariance(count)
    expected = np.zeros((2, 2))
    for k in range(count):
        for m in range(count):
            both = R[k - m] if k >= m else R[m - k].T
            expected += (rows[:, k] @ rows[:, m]) * both
    assert process.variance(index) == pytest.approx(np.diag(expected), rel=EXACT)
    verify_claim(
        "index.of_a_linear_system",
        claim="Indices of a linear system driven by noise, as covariances",
        where="`ps-fmu analyse indices`: closed form beside the runs",
        reference="double sums over the window of the autocovariance, written out",
        error=np.abs(process.covariance(index) - expected).max() / np.abs(expected).max(),
        bound=1e-9,
    )


@pytest.mark.parametrize("index", ALL, ids=identity)
def test_the_spectrum_gives_the_same(process, index):
    for row, column in ((0, 0), (0, 1), (1, 1)):

        def density(frequency, at=(row, column)):
            return process.psd(frequency.ravel())[:, *at].reshape(frequency.shape)

        found = index.variance_of_function(density, (0.0, 0.5 / STEP), step=STEP)
        assert process.covariance(index)[row, column] == pytest.approx(found, rel=EXACT)


@pytest.mark.parametrize("rho", ["-1/2", "0", "9/10", "9999/10000"])
def test_first_order_noise(rho):
    """Variance 1 and R_m = rho^m: geometric sums, as fractions, because floats lose digits near rho = 1."""
    rho = Fraction(rho)
    n = SAMPLES
    process = LinearProcess(np.array([[float(rho)]]), np.eye(1), np.array([[float(1 - rho**2)]]), STEP)
    run = (1 - rho**n) / (1 - rho)
    mean = (n * (1 + rho) / (1 - rho) - 2 * rho * run / (1 - rho)) / n**2
    apart = 50
    across = rho ** (apart - n + 1) * (run / n) ** 2
    for index, expected in (
        (AbsoluteError(), 1),
        (MeanError(WINDOW), mean),
        (UNIFORM, 1 - mean),
        (END, 1 + mean - 2 * run / n),
        (DriftError(WINDOW, apart * STEP), 2 * mean - 2 * across),
    ):
        expected = float(expected)
        assert process.variance(index)[0] == pytest.approx(expected, rel=EXACT)
        assert index.variance_of_function(
            lambda f: process.psd(f.ravel())[:, 0, 0].reshape(f.shape), (0.0, 0.5 / STEP), step=STEP
        ) == pytest.approx(expected, rel=EXACT)


@pytest.mark.parametrize("coefficients", [(1.8, -0.85), (1.98, -0.9802)])
def test_variance_of_second_order_noise(coefficients):
    """In fractions; the second has its poles at 0.99 +- 0.01 i, where 2e-12 of the digits are left by the data."""
    first, second = map(Fraction, coefficients)
    expected = (1 - second) / ((1 + second) * ((1 - second) ** 2 - first**2))
    A = np.array([coefficients, (1.0, 0.0)])
    process = LinearProcess(A, np.array([[1.0, 0.0]]), np.diag([1.0, 0.0]), STEP)
    assert process.variance(AbsoluteError())[0] == pytest.approx(float(expected), rel=1e-11)


@pytest.mark.parametrize("samples", [1, 2, 3, 30, 1000])
def test_a_random_walk(samples):
    """Increments of variance 1."""
    window, n, apart = samples * STEP, samples, 2 * samples
    walk = LinearProcess(np.eye(1), np.eye(1), np.eye(1), STEP)
    ramp = np.arange(n) - (n - 1) / 2.0
    tails = np.cumsum(ramp[::-1])[::-1][1:]  # what a step of the walk adds to the trend
    smear = (tails @ tails) / (ramp @ ramp) / n if n > 1 else 0.0
    uniform = (n**2 - 1.0) / (6.0 * n)
    for index, expected in (
        (RelativeError(window, "uniform"), uniform),
        (RelativeError(window, "end"), (n - 1.0) * (2.0 * n - 1.0) / (6.0 * n)),
        (DriftError(window, apart * STEP), apart - (n**2 - 1.0) / (3.0 * n)),
        (Smear(window), smear),
        (ResidualJitter(window), uniform - smear),
    ):
        assert walk.variance(index)[0] == pytest.approx(expected, rel=EXACT, abs=1e-12)
        found = index.variance_of_function(
            lambda f: walk.psd(f.ravel())[:, 0, 0].reshape(f.shape), (0.0, 0.5 / STEP), step=STEP
        )
        assert found == pytest.approx(expected, rel=EXACT, abs=1e-12)


@pytest.mark.parametrize("index", OFFSET_FREE, ids=identity)
def test_an_integrator_beside_a_resonance(index):
    """Driven together, with output noise; spectra have the same."""
    A = np.array([[1.0, 0.3, 0.0], [0.0, 0.9, 0.1], [0.0, -0.1, 0.9]])
    noise = np.array([[1.0, 0.2, 0.1], [0.2, 0.5, 0.0], [0.1, 0.0, 0.3]])
    process = LinearProcess(A, np.array([[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]), noise, STEP, 0.1 * np.eye(2))
    for at in ((0, 0), (0, 1), (1, 1)):
        found = index.variance_of_function(
            lambda f, at=at: process.psd(f.ravel())[:, *at].reshape(f.shape), (0.0, 0.5 / STEP), step=STEP
        )
        assert process.covariance(index)[at] == pytest.approx(found, rel=EXACT)


def test_indices_add_up_as_matrices(process):
    absolute, mean, relative, smear, jitter = (
        process.covariance(index) for index in (ALL[0], ALL[1], UNIFORM, Smear(WINDOW), ResidualJitter(WINDOW))
    )
    assert mean + relative == pytest.approx(absolute, rel=1e-12)
    assert smear + jitter == pytest.approx(relative, rel=1e-12)
    assert (np.linalg.eigvalsh(jitter) > 0.0).all()


@pytest.mark.parametrize("samples", [1, 255, 256, 257, 1000])
def test_windows_longer_than_a_block(samples):
    """Lags are taken in blocks: more than one, and a part of one."""
    process = LinearProcess(np.array([[0.999]]), np.eye(1), np.array([[1.0 - 0.999**2]]), STEP)
    found = process.autocovariance(samples)
    assert found.shape == (samples, 1, 1)
    assert found[:, 0, 0] == pytest.approx(0.999 ** np.arange(samples), rel=1e-10)


def test_processes_that_are_none():
    with pytest.raises(ValueError, match="neither stable nor an integrator"):
        LinearProcess(np.array([[1.01]]), np.eye(1), np.eye(1), STEP)
    with pytest.raises(ValueError, match=r"neither stable nor an integrator|chain"):
        LinearProcess(np.array([[1.0, 1.0], [0.0, 1.0]]), np.eye(2), np.eye(2), STEP)
    with pytest.raises(ValueError, match="do not fit"):
        LinearProcess(np.eye(2) * 0.5, np.eye(3), np.eye(2), STEP)
    with pytest.raises(ValueError, match="step: expected"):
        LinearProcess(np.eye(1) * 0.5, np.eye(1), np.eye(1), 0.0)
    walk = LinearProcess(np.eye(1), np.eye(1), np.eye(1), STEP)
    for index in (AbsoluteError(), MeanError(WINDOW)):
        with pytest.raises(ValueError, match=f"{index.symbol}: the process has integrators"):
            walk.variance(index)
    with pytest.raises(ValueError, match="no stationary covariance"):
        walk.autocovariance(3)
