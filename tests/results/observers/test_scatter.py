import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import ConvexHull
from support.claims import verify_claim

from ps_fmu.results.observers.scatter import ScatterObserver, convex_hull

NAMES = ["b.u", "b.v"]


@given(cuts=st.lists(st.integers(1, 499), max_size=8), seed=st.integers(0, 2**32 - 1))
def test_scatter_equals_the_direct_computation_for_any_cut(columns, feed, cuts, seed):
    values = np.random.default_rng(seed).normal(3e-6, 1e-6, (500, 4))
    result = feed(ScatterObserver(columns, NAMES), values, 0.1, cuts).result()
    points = values[:, 2:]
    radius = np.hypot(*(points - points.mean(axis=0)).T)
    hull = ConvexHull(points * 1e6)
    assert result.unit == "m"
    assert result.count == 500
    np.testing.assert_allclose(result.centre, points.mean(axis=0), rtol=1e-12)
    assert result.radius_rms == pytest.approx(np.sqrt((radius**2).mean()), rel=1e-12)
    assert result.radius_max == pytest.approx(radius.max(), rel=1e-12)
    assert result.hull_area == pytest.approx(hull.volume * 1e-12, rel=1e-9)
    assert {tuple(corner) for corner in result.hull} == {tuple(points[k]) for k in hull.vertices}


@pytest.mark.parametrize("ratio", [1.0, 0.3, 1e-3, 1e-9])
@pytest.mark.parametrize("angle", [0.0, 0.7, 2.0])
@pytest.mark.parametrize("slow", [0.0, 1.0])
def test_no_corner_of_the_hull_is_missed_whatever_its_shape(columns, feed, ratio, angle, slow):
    """Round, long and thin clouds, in any direction, with and without a slow motion that widens the hull again."""
    random, turns = np.random.default_rng(7), np.linspace(0.0, 30.0, 26_000)
    values = np.zeros((26_000, 4))
    u = random.standard_normal(26_000) + slow * 3.0 * np.sin(turns) * turns / 30.0
    v = ratio * (random.standard_normal(26_000) + slow * 3.0 * np.cos(turns) * turns / 30.0)
    values[:, 2] = 1e-6 * (np.cos(angle) * u - np.sin(angle) * v) + 5e-6
    values[:, 3] = 1e-6 * (np.sin(angle) * u + np.cos(angle) * v)
    result = feed(ScatterObserver(columns, NAMES), values, 0.1, range(0, 26_000, 2000)).result()
    at_once = convex_hull(values[:, 2:])
    assert {tuple(corner) for corner in result.hull} == {tuple(corner) for corner in at_once}


@pytest.mark.parametrize("seed", range(20))
def test_no_corner_is_missed_beside_an_offset(columns, feed, seed):
    """Jitter of 1e-12 m, beside an offset of a millimetre: a few thousand units of rounding."""
    values = np.zeros((3000, 4))
    values[:, 2:] = np.random.default_rng(seed).normal((1e-3, 0.7e-3), 1e-12, (3000, 2))
    result = feed(ScatterObserver(columns, NAMES), values, 0.1, ()).result()
    about = values[:, 2:] - values[0, 2:]  # exact
    hull = ConvexHull(about * 1e12)
    assert result.hull_area == pytest.approx(hull.volume * 1e-24, rel=1e-3)
    assert {tuple(corner) for corner in result.hull} >= {tuple(values[k, 2:]) for k in hull.vertices}


@given(cuts=st.lists(st.integers(1, 24_999), max_size=8))
def test_the_sample_is_even_and_bounded(columns, feed, cuts):
    values = np.arange(25_000.0)[:, None] * np.ones(4)
    points = feed(ScatterObserver(columns, NAMES, sample=100), values, 0.1, cuts).result().points
    assert 100 <= len(points) <= 200
    np.testing.assert_array_equal(np.diff(points[:, 0]), 128.0)


@pytest.mark.parametrize(
    ("points", "corners"),
    [
        ([[1.0, 2.0]] * 5, [[1.0, 2.0]]),
        ([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.5, 0.5]], [[0.0, 0.0], [2.0, 2.0]]),
        ([[0.0, 0.0], [1e-9, 0.0], [1e-9, 1e-9], [0.0, 1e-9], [5e-10, 5e-10]],
         [[0.0, 0.0], [1e-9, 0.0], [1e-9, 1e-9], [0.0, 1e-9]]),
    ],
)  # fmt: skip
def test_hulls_with_and_without_area(points, corners):
    hull = convex_hull(np.array(points))
    assert sorted(map(tuple, hull)) == sorted(map(tuple, corners))


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1.0])
@pytest.mark.parametrize("ratio", [1.0, 1e-3])
def test_the_hull_of_a_path_is_that_of_scipy(noise, ratio):
    """A spiral, smooth and in noise: its points lie close together, and many are corners."""
    turns = np.linspace(0.0, 20.0, 3000)
    points = 1e-6 * turns[:, None] * np.column_stack([np.cos(turns), ratio * np.sin(turns)])
    points += noise * 1e-6 * np.random.default_rng(5).standard_normal(points.shape) * [1.0, ratio]
    expected = points[ConvexHull(points * 1e6).vertices]
    assert len(expected) > 20
    verify_claim(
        "spectrum.image_point",
        claim="Hull of the image points",
        where="report of `ps-fmu run isolation`, `wheels`, `table2`: image point",
        reference="scipy.spatial.ConvexHull",
        error=len(set(map(tuple, convex_hull(points))) ^ set(map(tuple, expected))),
        bound=0,
        unit="corners that differ",
    )


def test_a_still_image_point(columns, feed):
    result = feed(ScatterObserver(columns, NAMES), np.zeros((50, 4)), 0.1, (20,)).result()
    assert result.radius_max == 0.0
    assert result.hull_area == 0.0


def test_what_is_not_an_image_point_is_refused(columns):
    with pytest.raises(ValueError, match="two coordinates"):
        ScatterObserver(columns, ["b.u"])
    with pytest.raises(ValueError, match="differ in unit"):
        ScatterObserver(columns, ["a.x", "b.u"])
    with pytest.raises(ValueError, match="sample"):
        ScatterObserver(columns, NAMES, sample=0)
