"""What the noise is made of: smooth steps, tables, layers of lines, phases."""

import numpy as np
import pytest

from ps_fmu.disturbance import multisine, spectrum
from ps_fmu.disturbance.sample_table import SampleTable


@pytest.mark.parametrize("weight", [lambda t: spectrum.ramp(t, 2.0), lambda t: spectrum.crossfade(t, 1.5)])
def test_derivatives_of_the_weights(weight):
    times, h = np.linspace(-0.5, 3.5, 401) + 1e-3, 1e-4
    before, here, after = weight(times - h), weight(times), weight(times + h)
    np.testing.assert_allclose(here.rate, (after.value - before.value) / (2 * h), atol=1e-6)
    np.testing.assert_allclose(here.curvature, (after.rate - before.rate) / (2 * h), atol=1e-5)


def test_product_of_weights():
    times = np.linspace(0.0, 3.0, 50)
    one, other = spectrum.ramp(times, 2.5), spectrum.crossfade(times, 1.5)
    g = [np.sin(times)[:, None], np.cos(times)[:, None], -np.sin(times)[:, None]]
    inner = other.value[:, None] * g[0]
    inner_1 = other.rate[:, None] * g[0] + other.value[:, None] * g[1]
    nested = one.second_derivative(inner, inner_1, other.second_derivative(*g))
    np.testing.assert_allclose(one.times(other).second_derivative(*g), nested, atol=1e-12)


def test_crossfade_keeps_the_power():
    times = np.linspace(0.0, 5.0, 101)
    pair = spectrum.crossfade(times, 5.0).value ** 2 + spectrum.crossfade(times + 5.0, 5.0).value ** 2
    np.testing.assert_allclose(pair, 1.0, rtol=1e-14)


def test_table_is_exact_on_its_grid_and_close_beside_it():
    rate, frequency = 400.0, 20.0  # Hz
    grid = np.arange(400) / rate
    table = SampleTable(np.outer(np.sin(2.0 * np.pi * frequency * grid), np.arange(1.0, 7.0)), rate, start=3.0)
    np.testing.assert_array_equal(table(3.0 + grid + 1e-10), table.values)
    beside = 3.0 + np.linspace(0.0, 2.0, 3001)  # past the end it begins again
    expected = np.outer(np.sin(2.0 * np.pi * frequency * (beside - 3.0)), np.arange(1.0, 7.0))
    np.testing.assert_allclose(table(beside) / np.arange(1.0, 7.0), expected / np.arange(1.0, 7.0), atol=5e-6)


def lagrange(values, position):
    """The polynomial through the six grid points around a position, in grid steps, of a periodic table."""
    nodes = int(np.floor(position)) + np.arange(-2, 4)
    weights = [np.prod([(position - b) / (a - b) for b in nodes if b != a]) for a in nodes]
    return weights @ values[nodes % len(values)]


def test_table_is_the_polynomial_through_six_points():
    values = np.random.default_rng(3).standard_normal((50, 6))
    times = np.sort(np.concatenate([np.linspace(-3.0, 13.0, 200), np.full(9, 1.23)]))
    expected = [lagrange(values, (time - 1.0) * 10.0) for time in times]
    np.testing.assert_allclose(SampleTable(values, 10.0, start=1.0)(times), expected, rtol=0.0, atol=1e-13)


def test_a_table_of_other_than_six_columns_is_refused():
    with pytest.raises(ValueError, match=r"a table of shape \(9, 5\): expected 6 columns"):
        SampleTable(np.zeros((9, 5)), 1.0)(np.zeros(1))


def test_factor_of_a_singular_spectrum():
    some = np.random.default_rng(1).standard_normal((6, 3))
    factor = spectrum.factor(some @ some.T)
    assert factor.shape == (6, 3)
    np.testing.assert_allclose(factor @ factor.T, some @ some.T, atol=1e-12)
    assert (factor[np.abs(factor).argmax(axis=0), range(3)] > 0.0).all()  # a sign that does not depend on LAPACK


@pytest.mark.parametrize("half", [False, True])
def test_layers_cover_the_band_once(half):
    layers = spectrum.layers(np.array([0.1, 1000.0]), 100.0, half=half, overlap=False)
    spacing = [0.01, 0.2]
    for layer, df, (low, high) in zip(layers, spacing, [(0.1, 20.0), (20.0, 1000.0)], strict=True):
        np.testing.assert_allclose(np.diff(layer.frequencies), df)
        assert layer.numbers.size == round((high - low) / df)
        assert low <= layer.frequencies[0] and layer.frequencies[-1] < high


def test_shares_of_overlapping_layers():
    slow, fast = spectrum.layers(np.array([0.1, 1000.0]), 5.0, half=False, overlap=True)
    shared = np.intersect1d(slow.numbers, fast.numbers)
    of_slow = spectrum.share(slow)[np.isin(slow.numbers, shared)]
    of_fast = spectrum.share(fast)[np.isin(fast.numbers, shared)]
    np.testing.assert_allclose(of_slow**2 + of_fast**2, 1.0)
    assert spectrum.share(slow)[0] == 1.0 and spectrum.share(fast)[-1] == 1.0


def test_integrals_of_a_sampled_line():
    (layer,) = spectrum.layers(np.array([0.5, 0.51]), 100.0, half=False, overlap=False)
    lines = np.zeros((6, 1), dtype=complex)
    lines[0] = 2.0 - 1.0j
    times, omega = np.arange(layer.points) / layer.rate, 2.0 * np.pi * 0.5
    expected = (lines[0] * np.exp(1j * omega * times)).real
    np.testing.assert_allclose(layer.sample(lines)[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(layer.sample(lines, 2)[:, 0], -expected / omega**2, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_phases_are_orthogonal_in_every_group(seed):
    frequencies = (np.arange(10, 215) + 0.5) / 100.0  # Hz; the last five do not fill a group
    found = multisine.orthogonal_phases(frequencies, 6, np.random.default_rng(seed))
    assert found.shape == (6, 205)
    groups = found.T[:200].reshape(10, 20, 6)
    for weight in (frequencies[:200] ** -4.0, np.ones(200)):
        inputs = np.exp(1j * groups) * np.sqrt(weight).reshape(10, 20, 1)
        gram = np.swapaxes(inputs.conj(), 1, 2) @ inputs
        gram /= np.trace(gram, axis1=1, axis2=2).real[:, None, None] / 6.0
        np.testing.assert_allclose(gram.real, np.broadcast_to(np.eye(6), (10, 6, 6)), atol=1e-7)
    np.testing.assert_allclose(gram.imag, 0.0, atol=1e-7)


def test_phases_of_one_input_or_few_lines_stay_random():
    for lines, inputs in ((100, 1), (7, 3)):
        found = multisine.orthogonal_phases(np.arange(1.0, lines + 1.0), inputs, np.random.default_rng(0))
        assert found.shape == (inputs, lines)
        assert (found >= 0.0).all() and (found < 2.0 * np.pi).all()
