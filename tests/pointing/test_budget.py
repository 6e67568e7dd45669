"""Budgets: contributions add up, each is what its source does alone, and they meet the exact covariances."""

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
from ps_fmu.pointing.budget import Budget, Source, UncertaintyFactors, make_budget
from ps_fmu.pointing.modal import StateSpace

STEP = 0.01  # s
ALL = (
    AbsoluteError(), MeanError(1.0), RelativeError(1.0, "uniform"), RelativeError(1.0, "end"), DriftError(1.0, 3.0),
    Smear(1.0), ResidualJitter(0.2),
)  # fmt: skip
EDGES = np.array([0.0, 0.5, 2.0, 5.0, 10.0, 50.0])  # Hz
FREQUENCY = np.linspace(0.1, 49.0, 300)  # Hz
MODES = ("a", "b", "rest")


def identity(index):
    return f"{index.symbol} {getattr(index, 'at', '')}"


def draw_complex(random, *shape):
    return random.normal(size=shape) + 1j * random.normal(size=shape)


@pytest.fixture(scope="module")
def sources():
    """Three correlated channels with spectra that turn with the frequency, two lines, one channel of flat noise."""
    random = np.random.default_rng(7)
    mixed = draw_complex(random, len(FREQUENCY), 3, 3)
    lines = np.array([37.0, 2.0, 10.0])  # Hz; one at an edge, and in no order
    return [
        Source("noise", ("x", "y", "z"), FREQUENCY, draw_complex(random, 3, 300, 2, 3), mixed @ mixed.conj().mT),
        Source("wheel", ("wheel",), lines, draw_complex(random, 3, 3, 2, 1), np.array([[2.0]]), lines=True),
        Source("coil", ("coil",), FREQUENCY, draw_complex(random, 3, 300, 2, 1), np.array([[0.3]])),
    ]


@pytest.mark.parametrize("step", [STEP, None])
@pytest.mark.parametrize("index", ALL, ids=identity)
def test_contributions_add_up(sources, index, step):
    """To the index of the error's density and lines, which know nothing of channels, bands and modes."""
    found = make_budget(index, sources, EDGES, step=step, modes=MODES)
    whole = 0.0
    for source in sources:
        G = source.response.sum(axis=0)
        of_error = np.trace(G @ np.broadcast_to(source.spectrum, (len(G), *source.spectrum.shape[-2:])) @ G.conj().mT,
                            axis1=1, axis2=2).real  # fmt: skip
        if source.lines:
            whole += index.weight(source.frequency, step) @ of_error
        else:
            whole += float(index.variance(source.frequency, of_error, step=step))
    assert found.variance == pytest.approx(whole, rel=1e-9)
    assert found.contribution.shape == (5, 5, 3)
    parts = [found.variance, found.rms**2, *(x.sum() for x in (found.by_channel, found.by_band, found.by_mode))]
    verify_claim(
        "budget.shares_add_up",
        claim="The shares by source, by frequency band and by mode each add up to the index",
        where="`ps-fmu analyse budget`: terminal, report and summary.json",
        reference="closed form of the index on the spectrum of the whole error, which knows no sources, bands or modes",
        error=np.abs(np.array(parts) / whole - 1.0),
        bound=1e-9,
    )


def test_a_source_alone_is_its_contribution(sources):
    index = RelativeError(1.0, "uniform")
    together = make_budget(index, sources, EDGES, step=STEP, modes=MODES)
    places = {"noise": slice(0, 3), "wheel": slice(3, 4), "coil": slice(4, 5)}
    for source in sources:
        alone = make_budget(index, [source], EDGES, step=STEP, modes=MODES)
        assert together.contribution[places[source.name]] == pytest.approx(alone.contribution, rel=1e-12)


def test_a_channel_that_is_correlated_with_no_other_is_what_it_does_alone():
    random = np.random.default_rng(3)
    G, levels = draw_complex(random, 300, 2, 3), np.array([1.0, 0.5, 3.0])
    together = make_budget(Smear(1.0), [Source("s", ("x", "y", "z"), FREQUENCY, G, np.diag(levels))], EDGES)
    for k in range(3):
        own = np.diag(np.where(np.arange(3) == k, levels, 0.0))
        alone = make_budget(Smear(1.0), [Source("s", ("x", "y", "z"), FREQUENCY, G, own)], EDGES)
        assert together.by_channel[k] == pytest.approx(alone.variance, rel=1e-12)
    assert (together.contribution > 0.0).all()


def test_cross_terms_are_shared_half_and_half():
    """|g1|^2 S11 + |g2|^2 S22 + 2 Re(g1 S12 conj(g2)); and two that cancel each other contribute nothing."""
    G = np.tile([[[1.0, 2.0 - 1.0j]]], (300, 1, 1))
    S = np.array([[1.0, 0.3 + 0.2j], [0.3 - 0.2j, 0.5]])
    width = FREQUENCY[-1] - FREQUENCY[0]
    found = make_budget(AbsoluteError(), [Source("s", ("one", "two"), FREQUENCY, G, S)], EDGES)
    cross = (S[0, 1] * np.conj(2.0 - 1.0j)).real
    assert found.by_channel == pytest.approx(width * np.array([1.0 + cross, 2.5 + cross]))
    opposite = Source("s", ("one", "two"), FREQUENCY, np.tile([[[1.0, -1.0]]], (300, 1, 1)), np.ones((2, 2)))
    assert make_budget(AbsoluteError(), [opposite], EDGES).by_channel == pytest.approx(np.zeros(2), abs=1e-12)
    mostly = Source("s", ("one", "two"), FREQUENCY, np.tile([[[1.0, -0.5]]], (300, 1, 1)), np.ones((2, 2)))
    assert make_budget(AbsoluteError(), [mostly], EDGES).by_channel == pytest.approx(width * np.array([0.5, -0.25]))


def test_bands_are_cut_between_samples_of_a_density():
    """A flat density: each band has the integral of the weight over it, wherever its samples lie."""
    frequency = np.array([0.0, 3.0, 50.0])
    index = RelativeError(1.0, "uniform")
    found = make_budget(index, [Source("s", ("s",), frequency, np.ones((3, 1, 1)), np.eye(1))], EDGES)
    for low, high, part in zip(EDGES[:-1], EDGES[1:], found.by_band, strict=True):
        assert part == pytest.approx(index.variance_of_function(np.ones_like, (low, high)), rel=1e-9)


def test_lines_have_the_weight_of_the_index():
    lines, amplitude = np.array([0.3, 7.0, 10.0, 50.0]), np.array([1.0, 2.0, 3.0, 4.0])
    spectrum = 0.5 * (amplitude**2)[:, None, None]
    source = Source("w", ("w",), lines, np.ones((4, 1, 1)), spectrum, lines=True)
    index = MeanError(1.0)
    found = make_budget(index, [source], EDGES)
    assert found.variance == pytest.approx(float(index.variance_of_lines(lines, amplitude)))
    weighed = index.weight(lines) * spectrum[:, 0, 0]
    assert found.by_band == pytest.approx([weighed[0], 0.0, 0.0, weighed[1], weighed[2] + weighed[3]])


def test_factors_scale_as_squares(sources):
    """With limits at an edge, in a band, and one above all."""
    index = RelativeError(1.0, "end")
    plain = make_budget(index, sources, EDGES, step=STEP, modes=MODES)
    double = make_budget(index, sources, EDGES, step=STEP, modes=MODES, factors=UncertaintyFactors((), (2.0,)))
    assert double.contribution == pytest.approx(4.0 * plain.contribution, rel=1e-12)
    factors = UncertaintyFactors((5.0, 90.0), (2.0, 1.5, 7.0))
    found = make_budget(index, sources, EDGES, step=STEP, modes=MODES, factors=factors)
    scale = np.array([4.0, 4.0, 4.0, 2.25, 2.25])
    assert found.contribution == pytest.approx(scale[:, None] * plain.contribution, rel=1e-12)
    assert found.variance == pytest.approx(found.contribution.sum(), rel=1e-9)
    within = UncertaintyFactors((3.0,), (2.0, 1.0))
    found = make_budget(index, sources, EDGES, step=STEP, modes=MODES, factors=within)
    finer = make_budget(index, sources, np.insert(EDGES, 3, 3.0), step=STEP, modes=MODES).contribution
    assert found.contribution[:, 2] == pytest.approx(4.0 * finer[:, 2] + finer[:, 3], rel=1e-9)
    assert factors.at([0.0, 4.9, 5.0, 100.0]).tolist() == [2.0, 2.0, 1.5, 7.0]


def process():
    """Two oscillators driven by three channels of white noise, in increments of a step."""
    A = np.zeros((4, 4))
    for k, (f, z) in enumerate(((3.0, 0.02), (8.0, 0.05))):
        w = 2.0 * np.pi * f * STEP
        turn = w * np.sqrt(1.0 - z * z)
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = np.exp(-z * w) * np.array(
            [[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]]
        )
    B = np.array([[0.0, 1.0, 0.2], [1.0, 0.0, 0.0], [0.0, 0.5, 1.0], [0.3, 0.0, -1.0]])
    return A, B, np.array([[1.0, 0.0, 1.0, 0.0], [0.0, 1.0, 0.5, 0.0]])


@pytest.mark.parametrize("index", ALL, ids=identity)
def test_white_noise_in_a_state_space_meets_its_covariances(index):
    """Lyapunov's equation knows no frequencies; the density is piecewise linear between 4000 of them."""
    A, B, C = process()
    covariance = np.array([[1.0, 0.4, 0.0], [0.4, 0.8, 0.0], [0.0, 0.0, 0.5]])
    exact = LinearProcess(A, C, B @ covariance @ B.T, STEP).variance(index).sum()
    frequency = np.unique(np.concatenate([np.linspace(0.0, 50.0, 2000), np.linspace(2.0, 10.0, 2000)]))
    modal = StateSpace((A - np.eye(4)) / STEP, B / STEP, C, STEP).modal_response(frequency)
    source = Source("s", ("x", "y", "z"), frequency, modal.parts, 2.0 * STEP * covariance)
    found = make_budget(index, [source], EDGES, step=STEP, modes=modal.names)
    assert found.variance == pytest.approx(exact, rel=1e-3)
    assert found.modes == ("3 Hz", "8 Hz", "rest")
    assert found.by_mode.sum() == pytest.approx(found.variance, rel=1e-9)
    assert abs(found.by_mode[2]) < 1e-9 * found.variance


def test_a_single_mode_is_the_whole_budget():
    """White noise of an oscillator: pi/2 of the half-power bandwidth times the height; and it lies in its band."""
    f, z = 3.0, 1e-3
    w = 2.0 * np.pi * f
    crowded = f * (1.0 + z * np.sinh(np.linspace(-8.0, 8.0, 4000)))
    frequency = np.unique(np.concatenate([np.linspace(0.1, 49.0, 2000), crowded]))
    frequency = frequency[(frequency >= 0.1) & (frequency <= 49.0)]
    modal = StateSpace(np.array([[0.0, 1.0], [-w * w, -2.0 * z * w]]), np.array([[0.0], [w * w]]), np.eye(2)[:1])
    response = modal.modal_response(frequency)
    source = Source("s", ("s",), frequency, response.parts, np.eye(1))
    found = make_budget(AbsoluteError(), [source], EDGES, modes=response.names)
    assert found.variance == pytest.approx(np.pi * f / (4.0 * z), rel=2e-3)
    assert found.by_mode[0] == pytest.approx(found.variance, rel=1e-9)
    channel, low, high, share = found.dominant()
    assert (channel, low, high) == ("s", 2.0, 5.0)
    assert 0.99 < share <= 1.0


def test_nothing_acts():
    found = make_budget(AbsoluteError(), [], EDGES)
    assert (found.variance, found.rms, found.share(0.0)) == (0.0, 0.0, 0.0)
    assert found.by_band.tolist() == [0.0] * 5
    assert isinstance(found, Budget)


def source(**changes):
    values = {"frequency": FREQUENCY, "response": np.ones((300, 2, 1)), "spectrum": np.eye(1), "channels": ("s",)}
    return Source(**({"name": "pump"} | values | changes))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"frequency": -FREQUENCY}, "pump, frequency: expected values"),
        ({"frequency": FREQUENCY[::-1]}, "pump, frequency: expected two or more ascending"),
        ({"frequency": FREQUENCY[:1], "response": np.ones((1, 1, 1))}, "pump, frequency: expected two or more"),
        ({"response": np.ones((300, 2))}, r"pump, response: expected \(300, signals, 1\)"),
        ({"response": np.ones((300, 2, 3))}, r"got \(300, 2, 3\)"),
        ({"spectrum": np.eye(2)}, r"pump, spectrum: expected \(300, 1, 1\) or \(1, 1\)"),
        ({"spectrum": np.array([[np.nan]])}, "must be finite"),
        ({"spectrum": np.array([[1.0j]])}, "pump, spectrum: expected Hermitian"),
    ],
)
def test_a_source_that_is_none_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        source(**changes)


@pytest.mark.parametrize(
    ("sources", "edges", "options", "message"),
    [
        ([source()], [0.0], {}, "edges: expected two or more ascending"),
        ([source()], [-1.0, 50.0], {}, "edges: expected two or more ascending"),
        ([source()], [0.0, 40.0], {}, "bands from 0 to 40 Hz do not cover pump, 0.1 to 49 Hz"),
        ([source()], [0.2, 50.0], {}, "do not cover pump"),
        ([source(), source()], EDGES, {}, "channels: there is more than one 's'"),
        ([source()], EDGES, {"modes": ("a", "b")}, "pump: its response has 1 modes, expected 2"),
        (
            [source(), source(name="fan", channels=("f",), response=np.ones((300, 1, 1)))], EDGES, {},
            "fan: its response has another number of signals than pump",
        ),
        ([source()], EDGES, {"step": 0.02}, "above half the rate"),
    ],
)  # fmt: skip
def test_a_budget_of_what_does_not_fit_is_refused(sources, edges, options, message):
    with pytest.raises(ValueError, match=message):
        make_budget(AbsoluteError(), sources, edges, **options)


@pytest.mark.parametrize(
    ("limits", "factors", "message"),
    [
        ((10.0, 5.0), (1.0, 1.0, 1.0), "limits: expected ascending"),
        ((0.0,), (1.0, 1.0), "limits: expected ascending frequencies above 0 Hz"),
        ((10.0,), (2.0,), "factors: expected 2 numbers"),
        ((), (-1.0,), "factors: expected 1 numbers"),
    ],
)
def test_factors_that_are_none_are_refused(limits, factors, message):
    with pytest.raises(ValueError, match=message):
        UncertaintyFactors(limits, factors)
