"""Noise: its spectrum, its lines and blocks, its density, and that any time can be computed on its own."""

import numpy as np
import pytest
from scipy.signal import welch
from support.claims import verify_claim

from ps_fmu.disturbance import default_settings, multisine_lines, psd_at_origin, spectrum
from ps_fmu.disturbance.gaussian import GaussianNoise
from ps_fmu.disturbance.multisine import Multisine
from ps_fmu.disturbance.noise import SpectrumTable
from ps_fmu.disturbance.spectrum import factor, gaussian_density, layers, share
from ps_fmu.mechanism.parameters import ParameterError, load
from ps_fmu.mechanism.quantities import replace_values
from ps_fmu.numerics.normal import Stream, make_key

NOISE = load().noise
PSD = NOISE.wrench_psd_B
LOW_BAND = np.array([0.1, 50.0])  # Hz
KINDS = pytest.mark.parametrize("kind", [GaussianNoise, Multisine])


def sampled(noise, step, duration, start=0.0, rows=50_000):
    """Rows at start, start + step, ... in blocks, as a run reads them."""
    count = round(duration / step)
    return np.concatenate([noise(start + np.arange(i, min(i + rows, count)) * step) for i in range(0, count, rows)])


def cross_spectra(values, step, length):
    """One-sided cross-spectra (frequencies, 6, 6) by averaging Hann-windowed segments."""
    window = np.hanning(length)
    segments = values[: len(values) // length * length].reshape(-1, length, 6)
    transform = np.fft.rfft(segments * window[:, None], axis=1)
    power = np.einsum("sfi,sfj->fij", transform, transform.conj()).real / len(segments)
    return np.fft.rfftfreq(length, step), 2.0 * step * power / (window @ window)


def free_body(force, step):
    """Velocity and position of a unit mass pushed from rest, force held over each step."""
    velocity = np.cumsum(force, axis=0) * step
    position = (np.cumsum(velocity, axis=0) - 0.5 * velocity) * step
    return velocity, position


def position_variance_per_psd(band):
    """Variance of G for white noise of unit one-sided density: integral of (2 pi f)^-4 over the band, s3."""
    return (band[0] ** -3 - band[1] ** -3) / (3.0 * (2.0 * np.pi) ** 4)


@KINDS
def test_a_function_of_time_and_seed_alone(kind):
    times = np.array([0.5, 3.2, 49.9997, 50.0, 50.0001, 123.4567])
    together = kind(PSD, NOISE.band, seed=5)(times)
    other_order = kind(PSD, NOISE.band, seed=5)
    for i in (4, 0, 5, 2, 1, 3):
        np.testing.assert_array_equal(other_order(times[i : i + 1])[0], together[i])
    assert np.abs(kind(PSD, NOISE.band, seed=6)(times) - together).min() > 0.0


@KINDS
@pytest.mark.parametrize(("step", "every", "of_fine"), [(1e-3, 1, 10), (2.5e-4, 2, 5)])
def test_step_sizes_agree_at_common_times(kind, step, every, of_fine):
    noise = kind(PSD, NOISE.band, seed=1)
    fine, coarse = np.arange(60_000) * 1e-4, np.arange(round(6.0 / step)) * step
    np.testing.assert_allclose(noise(coarse)[::every], noise(fine)[::of_fine], rtol=0.0, atol=1e-8)


@KINDS
def test_starts_from_rest_and_smoothly(kind):
    noise = kind(PSD, NOISE.band, seed=2)
    assert not noise(np.array([-1.0, 0.0])).any()
    assert np.abs(noise(np.arange(100) * 1e-4)).max() < 1e-3  # N, N.m; the noise itself: 24 N


@pytest.mark.parametrize(
    ("kind", "upper", "duration"),  # Hz, s; 15 Hz: the slow layer alone, which carries the motion
    [(GaussianNoise, 15.0, 1000.0), (GaussianNoise, 50.0, 200.0), (Multisine, 50.0, 402.0)],
)
def test_a_free_body_does_not_drift(kind, upper, duration):
    band, step = np.array([0.1, upper]), 2.5e-3  # Hz, s
    velocity, position = free_body(sampled(kind(PSD, band, seed=3), step, duration), step)
    deviation = np.sqrt(np.diag(PSD) * position_variance_per_psd(band))
    assert (np.abs(position) < 6.0 * deviation).all()
    assert (np.abs(velocity.mean(axis=0)) < 1e-2 * velocity.std(axis=0)).all()


def test_without_the_rise_the_same_body_would_drift():
    step = 2.5e-3  # s
    noise = Multisine(PSD, LOW_BAND, seed=3)
    velocity, _ = free_body(sampled(noise, step, 200.0, start=10.0), step)
    assert (np.abs(velocity.mean(axis=0)) > 0.1 * velocity.std(axis=0)).any()


def test_multisine_leaves_no_mean_velocity_or_position():
    """Over a whole repetition in the steady state both are zero: the rise leaves no impulse at all."""
    step = 2.5e-3  # s
    velocity, position = free_body(sampled(Multisine(PSD, LOW_BAND, seed=4), step, 202.0), step)
    for motion in (velocity, position):
        steady = motion[-80_000:]
        assert (np.abs(steady.mean(axis=0)) < 2e-4 * steady.std(axis=0)).all()


def test_gaussian_spectrum_is_the_given_matrix():
    band, step, length = np.array([0.5, 200.0]), 1e-3, 10_000
    values = sampled(GaussianNoise(PSD, band, seed=1), step, 300.0, start=2.0)
    frequencies, spectra = cross_spectra(values, step, length)
    scale = np.sqrt(np.outer(np.diag(PSD), np.diag(PSD)))
    # Below, within and above the change between the layers (15-20 Hz), and up to the edge.
    errors = []
    for low, high in ((1.0, 14.0), (14.0, 21.0), (21.0, 198.0)):
        inside = (frequencies > low) & (frequencies < high)
        error = np.abs(spectra[inside].mean(axis=0) - PSD) / scale
        independent = inside.sum() * len(values) / length / 1.5  # a Hann window is 1.5 lines wide
        errors.append(error.max() * np.sqrt(independent))
    verify_claim(
        "noise.spectrum",
        claim="Spectral matrix of the disturbance's noise, by band",
        where="`ps-fmu run`: the disturbance source",
        reference="cross-spectra of 300 s, Hann windows; 36 entries in three bands",
        error=max(errors),
        bound=5.0,
        unit="standard deviations",
    )
    outside = (frequencies < 0.2) | (frequencies > 201.0)
    assert (np.diagonal(spectra[outside], axis1=1, axis2=2) < 0.03 * np.diag(PSD)).all()


def test_gaussian_noise_is_gaussian_and_does_not_repeat():
    values = sampled(GaussianNoise(PSD, np.array([0.1, 15.0]), seed=9), 1e-2, 1000.0, start=2.0)
    normal = values / values.std(axis=0)
    assert np.abs((normal**3).mean(axis=0)).max() < 0.05
    assert np.abs((normal**4).mean(axis=0) - 3.0).max() < 0.1
    lag = 10_000  # 100 s, the length of a block
    assert np.abs((normal[lag:] * normal[:-lag]).mean(axis=0)).max() < 0.03


def test_gaussian_power_is_constant_over_the_blocks():
    """Mean square over seeds within each tenth of a block: the cross-fades keep the power."""
    band = np.array([0.5, 5.0])
    power = np.zeros(10)
    for seed in range(12):
        values = sampled(GaussianNoise(PSD, band, seed, period=10.0), 0.02, 200.0, start=10.0)
        power += (values[:, 0].reshape(-1, 10, 25) ** 2).mean(axis=(0, 2)) / 12.0
    np.testing.assert_allclose(power, PSD[0, 0] * 4.5, rtol=0.12)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_multisine_moves_a_free_body_with_the_exact_covariance(seed):
    """One window of T shows the covariance of independent inputs; random phases would miss it by 10 %."""
    step = 2.5e-3  # s
    _, position = free_body(sampled(Multisine(PSD, LOW_BAND, seed), step, 102.0), step)
    window = position[round(2.0 / step) :]
    lines = (np.arange(10, 5000) + 0.5) / 100.0  # Hz
    expected = PSD * np.sum((2.0 * np.pi * lines) ** -4.0) / 100.0
    scale = np.sqrt(np.outer(np.diag(expected), np.diag(expected)))
    verify_claim(
        "noise.multisine",
        claim="Covariance of what a multisine moves",
        where="`ps-fmu run table2`, `disturbance.noise.multisine`",
        reference="a free body of unit mass over one period, against the sum over the lines",
        error=np.abs((window.T @ window / len(window) - expected) / scale),
        bound=5e-3,
    )


def test_multisine_has_the_power_of_the_spectrum():
    values = sampled(Multisine(PSD, NOISE.band, seed=1), 5e-4, 200.0, start=2.0)
    scale = np.sqrt(np.outer(np.diag(PSD), np.diag(PSD))) * (NOISE.band[1] - NOISE.band[0])
    covariance = values.T @ values / len(values)
    assert np.abs((covariance - PSD * (NOISE.band[1] - NOISE.band[0])) / scale).max() < 0.01


@KINDS
def test_either_layer_may_be_empty(kind):
    for band in ([0.5, 5.0], [30.0, 300.0]):
        values = sampled(kind(PSD, np.array(band), seed=1), 1e-3, 100.0, start=2.0)
        np.testing.assert_allclose((values**2).mean(axis=0), np.diag(PSD) * np.ptp(band), rtol=0.2)


def test_times_far_apart_are_as_each_on_its_own():
    times = np.array([1e3, 2e3, 1e9])
    together = GaussianNoise(PSD, LOW_BAND, seed=5)(times)
    for time, expected in zip(times, together, strict=True):
        np.testing.assert_array_equal(GaussianNoise(PSD, LOW_BAND, seed=5)(np.array([time]))[0], expected)


def sum_lines(psd, band, seed, period, rise_time, time):
    """Gaussian noise at one time, line by line: ``d2/dt2 W w_i G_i``, of fast lines ``W w_i d2/dt2 G_i``."""
    total = np.zeros(6)
    for layer in layers(band, period, half=False, overlap=True):
        hop, omega = 0.5 * layer.period, 2.0 * np.pi * layer.frequencies
        for index in (int(time // hop), int(time // hop) + 1):
            key = make_key(Stream.GAUSSIAN, seed, layer.key, index)
            u, v = np.random.Generator(np.random.Philox(np.random.SeedSequence(key))).random((2, 6, omega.size))
            random = np.sqrt(-2.0 / layer.period * np.log1p(-u)) * np.exp(2j * np.pi * v)
            elapsed = time - (index - 1) * hop
            lines = factor(psd) @ (random * share(layer)) * np.exp(1j * omega * elapsed)
            g_2, g_1, g = (lines.real.sum(axis=1), *((lines / (1j * omega) ** k).real.sum(axis=1) for k in (1, 2)))
            weight = spectrum.crossfade(np.array([elapsed]), hop).times(spectrum.ramp(np.array([time]), rise_time))
            is_fast = omega.min() * min(rise_time, hop) >= 25.0 * 2.0 * np.pi
            total += weight.value * g_2 if is_fast else weight.second_derivative(g[None], g_1[None], g_2[None])[0]
    return total


@pytest.mark.parametrize(("period", "highest"), [(20.0, 800.0), (1.5, 60.0), (37.3, 15.0), (41.005, 15.0)])
@pytest.mark.parametrize("times", [[0.5, 1.25, 1.9975], [2.4975, 2.5, 7.75, 60.0]])
def test_noise_is_the_sum_of_its_lines(period, highest, times):
    """While it rises and later, at points of the grid, which is finer for the two last periods."""
    band = np.array([2.0 / period if period < 2.0 else 1.0, highest])  # Hz
    grid = layers(band, period, half=False, overlap=True)[0]
    hop = 0.5 * grid.period  # blocks begin at multiples of it, on their grid
    times = [time // hop * hop + round(time % hop * grid.rate) / grid.rate for time in times]
    assert (grid.rate == 400.0) == (highest > 20.0)
    found = GaussianNoise(PSD, band, 7, period)(np.array(times))
    expected = [sum_lines(PSD, band, 7, period, 2.0, time) for time in times]
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-11 * np.abs(expected).max())


@KINDS
def test_no_noise_at_all(kind):
    assert not kind(np.zeros((6, 6)), NOISE.band, seed=1)(np.arange(10) * 1.0).any()


def test_the_spectrum_at_another_point():
    """Torque about the origin = torque about the centre of mass + lever x force, for any sample of the noise."""
    com = np.array([0.3, -0.2, -2.0])
    factor = np.linalg.cholesky(PSD + 1e-6 * np.eye(6))
    moved = np.concatenate([factor[:3], factor[3:] + np.cross(com, factor[:3], axisb=0).T])
    np.testing.assert_allclose(psd_at_origin(factor @ factor.T, com), moved @ moved.T, atol=1e-12)


def test_lines_of_the_multisine_are_what_it_plays():
    frequency, amplitude = multisine_lines(PSD, LOW_BAND, seed=2, period=20.0)
    times = np.array([7.3, 41.0, 123.4])
    expected = (np.exp(2j * np.pi * np.outer(times, frequency)) @ amplitude).real
    played = Multisine(PSD, LOW_BAND, seed=2, period=20.0)(times)
    np.testing.assert_allclose(played, expected, rtol=0.0, atol=2e-5 * np.abs(expected).max())


BAND = np.array([0.1, 50.0])


def test_a_free_body_moves_as_much_as_by_the_lines():
    """Motion is the double integral w g: its mean square is that of the lines, since the squares of w add up to one."""
    frequency = np.arange(1, 4001) * 1e-4 + 1e-5  # to 0.4 Hz: the next lines have less than a percent of it
    band = np.array([0.1, 0.3])
    moved = np.sum(gaussian_density(band, 100.0, frequency) / frequency**4) * 1e-4
    lines = np.arange(10, 30) / 100.0
    assert moved == pytest.approx(np.sum(lines**-4.0) / 100.0, rel=1e-6)


def test_it_is_flat_within_the_band():
    frequency = np.geomspace(1.0, 49.0, 500)
    assert gaussian_density(BAND, 100.0, frequency) == pytest.approx(np.ones(500), abs=1e-2)
    inside = frequency > 25.0
    assert gaussian_density(BAND, 100.0, frequency[inside]) == pytest.approx(np.ones(inside.sum()), abs=1e-3)
    assert gaussian_density(BAND, 100.0, np.array([0.02, 55.0])) == pytest.approx(np.zeros(2), abs=1e-6)


def test_records_have_it():
    """Welch spectra of 3200 s; bands with some hundred independent values, at the edges as well."""
    noise = GaussianNoise(np.diag([1.0, 0.0, 0.0, 0.0, 0.0, 0.0]), BAND, seed=3)
    step, blocks = 5e-3, 32
    record = np.concatenate([noise(100.0 * (k + 1) + np.arange(20_000) * step)[:, 0] for k in range(blocks)])
    frequency, density = welch(record, 1.0 / step, nperseg=20_000)
    expected = np.zeros(len(density))
    expected[1:] = gaussian_density(BAND, 100.0, frequency[1:])
    errors = []
    for low, high in ((0.08, 0.2), (1.0, 5.0), (14.0, 21.0), (49.5, 49.8), (49.8, 50.2)):
        within = (frequency >= low) & (frequency < high)
        scatter = expected[within].mean() / np.sqrt(blocks * (high - low) * 100.0 * 0.5)
        errors.append(abs(density[within].mean() - expected[within].mean()) / scatter)
    verify_claim(
        "noise.edges",
        claim="Density of the noise at the edges of its band",
        where="`ps-fmu analyse indices`, `analyse budget`",
        reference="scipy.signal.welch on 3200 s of the generator's noise, in five bands",
        error=max(errors),
        bound=4.0,
        unit="standard deviations",
    )


# --- Spectra from files -------------------------------------------------------------------------------------------


@pytest.fixture
def spectrum_file(tmp_path):
    """A force with a slope and a step, and a torque with a peak; one-sided."""
    path = tmp_path / "spectrum.csv"
    path.write_text(
        "torque.z [N2.m2/Hz],frequency [Hz],force.x [N2/Hz]\n"
        "1e-9,0.5,1e-6\n1e-8,10,1e-4\n4e-7,30,1e-4\n4e-7,30.5,1e-6\n1e-9,100,1e-8\n"
    )
    return path


def read_rows(path, frequency):
    """Densities of force and torque (n, 2) at frequencies (n,), Hz, from the rows of the file, without its reader."""
    rows = np.log(np.loadtxt(path, delimiter=",", skiprows=1))
    at = np.log(frequency)
    return np.exp(np.stack([np.interp(at, rows[:, 1], rows[:, column]) for column in (2, 0)], axis=1))


def settings_of(path, **more):
    values = {"spectrum": str(path), "period": 20.0, "scale": 2.0, "band.min": 0.5, **more}
    return replace_values(default_settings(load()), {f"noise.{name}": value for name, value in values.items()})


def test_logarithms_are_linear_between_the_rows(spectrum_file):
    table = SpectrumTable.read(spectrum_file, "spectrum")
    assert table.axes == [0, 5]
    frequency = np.array([0.4, 0.5, np.sqrt(5.0), 10.0, 20.0, 100.0, 101.0])
    expected = [0.0, 1e-6, 1e-5, 1e-4, 1e-4, 1e-8, 0.0]
    np.testing.assert_allclose(table.root(frequency)[0] ** 2, expected, rtol=1e-9)
    fine = np.geomspace(0.5, 100.0, 200_001)
    whole = np.trapezoid(table.root(fine) ** 2, fine, axis=1)
    np.testing.assert_allclose(table.integrate(0.1, 1000.0)[[0, 5]], whole, rtol=1e-4)


@pytest.mark.parametrize("multisine", [False, True])
def test_noise_has_the_spectrum_of_the_file(spectrum_file, multisine):
    """Welch's density of the samples, and their mean square, at the centre of mass of the bus."""
    settings, step = settings_of(spectrum_file, multisine=multisine), 2e-3
    noise, table = settings.kinds["noise"].make_source(settings, 1), SpectrumTable.read(spectrum_file, "spectrum")
    wrench = noise(2.0 + np.arange(400_000) * step)
    com_B = settings.bus.com_B
    at_com = np.hstack([wrench[:, :3], wrench[:, 3:] - np.cross(com_B, wrench[:, :3])])
    quiet = [axis for axis in range(6) if axis not in table.axes]
    np.testing.assert_allclose(at_com[:, quiet], 0.0, atol=1e-12)
    frequency, density = welch(at_com[:, table.axes], 1.0 / step, nperseg=10_000, axis=0)
    wanted = 4.0 * read_rows(spectrum_file, frequency[1:])  # the scale is 2
    for low, high in ((1.0, 8.0), (11.0, 29.0), (32.0, 90.0)):
        inside = (frequency[1:] > low) & (frequency[1:] < high)
        measured, expected = density[1:][inside].sum(axis=0), wanted[inside].sum(axis=0)
        np.testing.assert_allclose(measured, expected, rtol=0.1)
    fine = np.geomspace(0.5, 100.0, 100_001)
    whole = 4.0 * np.trapezoid(read_rows(spectrum_file, fine), fine, axis=0)
    verify_claim(
        "noise.spectrum_of_a_file",
        claim="Noise with the spectrum of a file",
        where="`disturbance.noise.spectrum`",
        reference="mean square of 800 s against the integral of the densities",
        error=np.abs(np.mean(at_com[:, table.axes] ** 2, axis=0) / whole - 1.0).max(),
        bound=0.05,
    )


def test_the_density_of_a_spectrum_on_average_is_that_of_the_file(spectrum_file):
    """But at steps, and at the edges of the band, which are as wide as a line."""
    settings = settings_of(spectrum_file)
    noise, table = settings.kinds["noise"], SpectrumTable.read(spectrum_file, "spectrum")
    frequency = np.array([1.0, 3.0, 12.0, 20.0, 50.0, 90.0])
    found = gaussian_density(noise.band, noise.period, frequency, table.root)
    np.testing.assert_allclose(found, table.root(frequency) ** 2, rtol=0.01)


def test_what_the_band_cuts_off_is_said(spectrum_file):
    assert settings_of(spectrum_file).kinds["noise"].explain() is None
    text = settings_of(spectrum_file, **{"band.max": 20.0}).kinds["noise"].explain()
    assert text.startswith("spectrum.csv reaches from 0.5 to 100 Hz; the noise is what lies between noise.band.min = ")
    table = SpectrumTable.read(spectrum_file, "spectrum")
    lost = 1.0 - (table.integrate(0.5, 20.0)[5] / table.integrate(0.5, 100.0)[5])
    assert f"leaves out up to {100.0 * lost:.0f} %" in text


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("1e-9,0.5", "1e-9,0", "the first frequency must be above 0, got 0 Hz"),
        ("10,1e-4", "10,0", r"'force.x \[N2/Hz\]' at 10 Hz: expected a density above 0, got 0; leave out the columns"),
        ("10,1e-4", "0.4,1e-4", "line 3: the frequency 0.4 Hz does not come after 0.5 Hz"),
        ("force.x [N2/Hz]", "force.x [N/sqrt(Hz)]", r"column 'force.x .* must be 'force.x \[N2/Hz\]'"),
        ("torque.z [N2.m2/Hz],frequency [Hz],force.x [N2/Hz]", "a,frequency [Hz],b", "no column beside 'frequency"),
    ],
)
def test_spectra_that_cannot_be_used(spectrum_file, old, new, problem):
    spectrum_file.write_text(spectrum_file.read_text().replace(old, new))
    settings = settings_of(spectrum_file)
    with pytest.raises(ParameterError, match=problem):
        settings.kinds["noise"].make_source(settings, 1)


def test_a_spectrum_outside_the_band(spectrum_file):
    settings = settings_of(spectrum_file, **{"band.min": 200.0})
    with pytest.raises(ParameterError, match=r"spectrum: .* from 0.5 to 100 Hz, and band.min and band.max are 200"):
        settings.kinds["noise"].make_source(settings, 1)
