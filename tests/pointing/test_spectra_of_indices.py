"""Variances from spectra: white, integrated white and coloured noise, and lines, against closed forms."""

import math

import numpy as np
import pytest
from scipy.signal import welch
from scipy.special import sici
from support.claims import verify_claim

from ps_fmu.pointing import AbsoluteError, DriftError, MeanError, RelativeError, ResidualJitter, Smear

WINDOW = 2.0  # s
EXACT = 1e-9
UNIFORM, END = RelativeError(WINDOW, "uniform"), RelativeError(WINDOW, "end")
ALL = AbsoluteError(), MeanError(WINDOW), UNIFORM, END, DriftError(WINDOW, 5.0), Smear(WINDOW), ResidualJitter(WINDOW)


@pytest.mark.parametrize("high", [0.1, 3.3, 400.0])
def test_white_noise_in_a_band(high):
    """Integrals of j0^2, 3 j1^2 and the weight with t at the end, by the sine integral."""
    u = math.pi * high * WINDOW
    sine, cosine, integral = math.sin(u), math.cos(u), sici(2.0 * u)[0]
    per_hertz = 1.0 / (math.pi * WINDOW)
    mean = (integral - sine**2 / u) * per_hertz
    trend = (integral - sine**2 / u**3 + 2.0 * sine * cosine / u**2 - (cosine**2 + 2.0 * sine**2) / u) * per_hertz
    end = (2.0 * u - (1.0 - math.cos(2.0 * u)) / u) * per_hertz / 2.0
    expected = {
        MeanError(WINDOW): mean,
        UNIFORM: high - mean,
        END: end,
        Smear(WINDOW): trend,
        ResidualJitter(WINDOW): high - mean - trend,
    }
    errors = []
    for index, value in expected.items():
        function = index.variance_of_function(lambda f: np.full(f.shape, 3.0), (0.0, high))
        errors += [found / (3.0 * value) - 1.0 for found in (float(index.variance([0.0, high], [3.0, 3.0])), function)]
    verify_claim(
        "index.of_a_spectrum",
        claim="Indices of a spectrum of the error",
        where="`ps-fmu analyse budget`, `analyse indices`, `ps_fmu.pointing`",
        reference="white noise in a band: closed forms by the sine integral",
        error=np.abs(errors),
        bound=1e-9,
    )


@pytest.mark.parametrize("samples", [1, 2, 7, 200])
def test_white_samples(samples):
    """Variance 1 and no correlation: density 2 dt up to half the sampling rate."""
    step = 0.01
    window, n = samples * step, samples
    cases = [
        (AbsoluteError(), 1.0),
        (MeanError(window), 1.0 / n),
        (RelativeError(window, "uniform"), 1.0 - 1.0 / n),
        (RelativeError(window, "end"), 1.0 - 1.0 / n),
        (DriftError(window, 3.0 * window), 2.0 / n),
        (Smear(window), 1.0 / n if n > 1 else 0.0),
        (ResidualJitter(window), max(1.0 - 2.0 / n, 0.0)),
    ]
    for index, expected in cases:
        found = index.variance([0.0, 0.5 / step], [2.0 * step] * 2, step=step)
        assert found == pytest.approx(expected, rel=EXACT, abs=1e-13)


def test_integrated_white_noise():
    """Random walk of T/2 per unit of density: RPE uniform T/12, smear T/20, jitter T/30; at the end T/6.

    The tail above the band is that of the weight's mean, 1, and of the mean of j0^2, 1/(2 u^2).
    """
    high = 600.0

    def psd(frequency):
        return 1.0 / (2.0 * np.pi * frequency) ** 2

    tail = 1.0 / (4.0 * math.pi**2 * high)
    third = 1.0 / (4.0 * math.pi**2) / (6.0 * math.pi**2 * WINDOW**2 * high**3)
    for index, share, correction in (
        (UNIFORM, 1.0 / 12.0, tail - third),
        (ResidualJitter(WINDOW), 1.0 / 30.0, tail - 4.0 * third),
        (Smear(WINDOW), 1.0 / 20.0, 3.0 * third),
    ):
        found = index.variance_of_function(psd, (0.0, high)) + correction
        assert found == pytest.approx(share * WINDOW, rel=EXACT)
    assert END.variance_of_function(psd, (0.0, high)) + tail == pytest.approx(WINDOW / 6.0, rel=1e-6)


def oscillator(frequency, resonance=0.7, damping=0.05):
    """Density of a resonance with variance 1."""
    ratio = frequency / resonance
    return 4.0 * damping / (math.pi * resonance) / ((1.0 - ratio**2) ** 2 + (2.0 * damping * ratio) ** 2)


def oscillator_moment(window, resonance=0.7, damping=0.05):
    """int_0^T R dt, int t R dt, ... int t^3 R dt of its autocovariance R, each by the next."""
    omega = 2.0 * math.pi * resonance
    damped = omega * math.sqrt(1.0 - damping**2)
    s = complex(-damping * omega, damped)
    amplitude = 1.0 - 1j * damping * omega / damped  # R = Re(amplitude e^{s t})
    moments = [(np.exp(s * window) - 1.0) / s]
    for power in (1, 2, 3):
        moments.append((window**power * np.exp(s * window) - power * moments[-1]) / s)
    return [float((amplitude * moment).real) for moment in moments]


def test_noise_through_a_resonance():
    """Closed forms from the autocovariance; what lies above the band is below 1e-10."""
    T = WINDOW
    m0, m1, _, m3 = oscillator_moment(T)
    mean = 2.0 / T**2 * (T * m0 - m1)
    trend = 2.0 * 12.0 / T**4 * (T**3 / 12.0 * m0 - T**2 / 4.0 * m1 + m3 / 6.0)
    end = 1.0 + mean - 2.0 / T * m0
    band = (0.0, 1500.0)
    cases = [(AbsoluteError(), 1.0), (MeanError(T), mean), (UNIFORM, 1.0 - mean), (END, end), (Smear(T), trend)]
    for index, expected in [*cases, (ResidualJitter(T), 1.0 - mean - trend)]:
        assert index.variance_of_function(oscillator, band, points=[0.7]) == pytest.approx(expected, rel=EXACT)


def test_lines_add_up():
    frequency, amplitude = np.array([0.1, 0.25, 7.0]), np.array([[1.0, 2.0], [3.0j, 0.0], [0.5, 1.0]])
    found = MeanError(WINDOW).variance_of_lines(frequency, amplitude)
    j0 = np.sinc(frequency * WINDOW)
    first, second = j0**2 @ [1.0, 9.0, 0.25], j0**2 @ [4.0, 0.0, 1.0]
    assert found == pytest.approx([0.5 * first, 0.5 * second])
    assert UNIFORM.variance_of_lines([1000.25], [2.0]) == pytest.approx(2.0, rel=1e-6)


@pytest.mark.parametrize("index", ALL, ids=lambda index: index.symbol)
def test_a_coarse_grid_misses_nothing(index):
    """The density is linear between three samples; the weight oscillates a thousand times between them."""
    frequency, psd = np.array([0.0, 150.0, 500.0]), np.array([1.0, 5.0, 2.0])
    expected = index.variance_of_function(lambda f: np.interp(f, frequency, psd), (0.0, 500.0), points=[150.0])
    assert index.variance(frequency, psd) == pytest.approx(expected, rel=1e-10)
    assert index.quadrature(frequency) @ psd == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("index", ALL, ids=lambda index: index.symbol)
def test_power_laws(index):
    """A specification in dB per octave: three samples, straight in a log-log plot."""
    frequency, psd = np.array([0.02, 1.0, 500.0]), np.array([[4.0, 1.0], [1.0, 1.0], [1e-5, 2.0]])
    found = index.variance(frequency, psd, interpolation="power law")
    for signal in (0, 1):

        def density(f, values=psd[:, signal]):
            return np.exp(np.interp(np.log(f), np.log(frequency), np.log(values)))

        expected = index.variance_of_function(density, (0.02, 500.0), points=[1.0])
        assert found[signal] == pytest.approx(expected, rel=1e-9)


def test_bins_of_a_welch_spectrum():
    """The plain sum for APE; for windows, the mean of the weight over each bin."""
    step = 0.01
    record = np.random.default_rng(4).normal(size=20_000)
    frequency, psd = welch(record, 1.0 / step, "hann", nperseg=2000, detrend=False)
    assert AbsoluteError().variance(frequency, psd, interpolation="bins", step=step) == pytest.approx(psd.sum() * 0.05)
    flat = np.full(frequency.shape, 2.0 * step)
    flat[[0, -1]] /= 2.0  # as Welch has it: the density of the first and last bin is not doubled
    for index, expected in ((MeanError(0.5), 0.02), (RelativeError(0.5, "uniform"), 0.98), (Smear(0.5), 0.02)):
        assert index.variance(frequency, flat, interpolation="bins", step=step) == pytest.approx(expected, rel=1e-9)


def test_matrices_and_axes():
    frequency = np.linspace(0.0, 10.0, 21)
    density = 1.0 + frequency
    matrix = density[:, None, None] * np.array([[2.0, 1.0], [1.0, 3.0]])
    one = float(END.variance(frequency, density))
    assert END.variance(frequency, matrix) == pytest.approx(one * np.array([[2.0, 1.0], [1.0, 3.0]]))
    assert END.variance(frequency, np.stack([density, 4.0 * density]), axis=-1) == pytest.approx([one, 4.0 * one])
    assert END.rms(frequency, 4.0 * density) == pytest.approx(2.0 * math.sqrt(one))


def test_what_cannot_be_integrated_is_refused():
    with pytest.raises(ValueError, match="does not converge"):
        MeanError(1.0).variance_of_function(lambda f: 1.0 / f**2, (0.0, 10.0))
    with pytest.raises(ValueError, match="band: expected"):
        MeanError(1.0).variance_of_function(np.ones_like, (0.0, math.inf))
    with pytest.raises(ValueError, match="ascending"):
        MeanError(1.0).variance([0.0, 2.0, 1.0], [1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="3 values along axis 0"):
        MeanError(1.0).variance([0.0, 2.0], [1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="equally spaced"):
        MeanError(1.0).variance([0.0, 2.0, 5.0], [1.0, 1.0, 1.0], interpolation="bins")
    with pytest.raises(ValueError, match="above 0"):
        MeanError(1.0).variance([0.0, 2.0], [1.0, 1.0], interpolation="power law")
    with pytest.raises(ValueError, match="interpolation: expected"):
        MeanError(1.0).variance([0.0, 2.0], [1.0, 1.0], interpolation="cubic")
