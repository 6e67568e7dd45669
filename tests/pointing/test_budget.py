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
    spectra,
)
from ps_fmu.pointing.budget import Budget, Source, UncertaintyFactors, make_budget
from ps_fmu.pointing.modal import Resonance, StateSpace, find_resonances
from ps_fmu.pointing.spectra import gather_lines

STEP = 0.01  # s
ALL = (
    AbsoluteError(), MeanError(1.0), RelativeError(1.0, "uniform"), RelativeError(1.0, "end"), DriftError(1.0, 3.0),
    Smear(1.0), ResidualJitter(0.2),
)  # fmt: skip
EDGES = np.array([0.0, 0.5, 2.0, 5.0, 10.0, 50.0])  # Hz
FREQUENCY = np.linspace(0.1, 49.0, 300)  # Hz
RESONANCES = (Resonance((1.0,), 0.7, 1.4), Resonance((3.0, 3.1), 1.9, 4.1))


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
        Source("noise", ("x", "y", "z"), FREQUENCY, draw_complex(random, 300, 2, 3), mixed @ mixed.conj().mT),
        Source("wheel", ("wheel",), lines, draw_complex(random, 3, 2, 1), np.array([[2.0]]), lines=True),
        Source("coil", ("coil",), FREQUENCY, draw_complex(random, 300, 2, 1), np.array([[0.3]])),
    ]


@pytest.mark.parametrize("step", [STEP, None])
@pytest.mark.parametrize("index", ALL, ids=identity)
def test_contributions_add_up(sources, index, step):
    """To the index of the error's density and lines, which know nothing of channels, bands and modes."""
    found = make_budget(index, sources, EDGES, step=step, resonances=RESONANCES)
    whole = 0.0
    for source in sources:
        G = source.response
        of_error = np.trace(G @ np.broadcast_to(source.spectrum, (len(G), *source.spectrum.shape[-2:])) @ G.conj().mT,
                            axis1=1, axis2=2).real  # fmt: skip
        if source.lines:
            whole += index.weight(source.frequency, step) @ of_error
        else:
            whole += float(index.variance(source.frequency, of_error, step=step))
    assert found.variance == pytest.approx(whole, rel=1e-9)
    assert found.pairs.shape == (5, 5, 5)
    assert found.by_resonance.shape == (3,)
    by_line = sum(found.contribution(line).sum() for line in found.lines)
    sums = [part.sum() for part in (found.pairs, found.by_band, found.by_resonance)]
    parts = [found.variance, found.rms**2, by_line, *sums]
    verify_claim(
        "budget.shares_add_up",
        claim="The shares by source, by frequency band and by resonance each add up to the index",
        where="`ps-fmu analyse budget`: terminal, budget.html and budget.json",
        reference="closed form of the index on the spectrum of the whole error, which knows no sources, bands or modes",
        error=np.abs(np.array(parts) / whole - 1.0),
        bound=1e-9,
    )


def test_a_source_alone_is_its_contribution(sources):
    index = RelativeError(1.0, "uniform")
    together = make_budget(index, sources, EDGES, step=STEP, resonances=RESONANCES)
    places = {"noise": slice(0, 3), "wheel": slice(3, 4), "coil": slice(4, 5)}
    for source in sources:
        alone = make_budget(index, [source], EDGES, step=STEP, resonances=RESONANCES)
        place = places[source.name]
        assert together.pairs[:, place, place] == pytest.approx(alone.pairs, rel=1e-12)


def test_a_channel_that_is_correlated_with_no_other_is_what_it_does_alone():
    random = np.random.default_rng(3)
    G, levels = draw_complex(random, 300, 2, 3), np.array([1.0, 0.5, 3.0])
    together = make_budget(Smear(1.0), [Source("s", ("x", "y", "z"), FREQUENCY, G, np.diag(levels))], EDGES)
    for k in range(3):
        own = np.diag(np.where(np.arange(3) == k, levels, 0.0))
        alone = make_budget(Smear(1.0), [Source("s", ("x", "y", "z"), FREQUENCY, G, own)], EDGES)
        assert together.alone[k] == pytest.approx(alone.rms, rel=1e-12)
    assert together.alone**2 @ np.ones(3) == pytest.approx(together.variance, rel=1e-12)
    assert sorted(line.name for line in together.lines) == ["x", "y", "z"]
    assert together.correlation == pytest.approx(np.eye(3), abs=1e-12)


def correlated(G, S):
    """The budget of two channels, the same at all frequencies."""
    ways = np.tile(np.array(G, dtype=complex), (300, 1, 1))
    return make_budget(AbsoluteError(), [Source("s", ("s one", "s two"), FREQUENCY, ways, np.array(S))], EDGES)


def test_cross_terms_are_shared_half_and_half():
    """|g1|^2 S11 + |g2|^2 S22 + 2 Re(g1 S12 conj(g2))."""
    width = FREQUENCY[-1] - FREQUENCY[0]
    found = correlated([[1.0, 2.0 - 1.0j]], [[1.0, 0.3 + 0.2j], [0.3 - 0.2j, 0.5]])
    cross = ((0.3 + 0.2j) * np.conj(2.0 - 1.0j)).real
    assert found.pairs.sum(axis=0) == pytest.approx(width * np.array([[1.0, cross], [cross, 2.5]]))
    assert found.alone == pytest.approx(np.sqrt(width * np.array([1.0, 2.5])))
    assert found.correlation[0, 1] == pytest.approx(cross / np.sqrt(2.5))
    assert [line.name for line in found.lines] == ["s two", "s one"]
    assert found.contribution(found.lines[0]).sum() == pytest.approx(width * (2.5 + cross))


def test_channels_that_cancel_each_other_are_one_line():
    """With what each makes alone: 1.00 and 0.98, correlated by -1, leave 0.02."""
    found = correlated([[0.98, -1.0]], np.ones((2, 2)))
    (line,) = found.lines
    assert (line.name, line.channels) == ("s two with one", (1, 0))
    assert found.rms == pytest.approx(0.02 * np.sqrt(48.9))
    assert found.alone == pytest.approx(np.array([0.98, 1.0]) * np.sqrt(48.9))
    assert found.correlation == pytest.approx(np.array([[1.0, -1.0], [-1.0, 1.0]]))
    assert found.share(found.contribution(line).sum()) == pytest.approx(1.0)
    nothing = correlated([[1.0, -1.0]], np.ones((2, 2)))
    assert nothing.variance == pytest.approx(0.0, abs=1e-12)


def test_no_share_is_below_zero_or_above_all():
    """Of six strongly correlated channels, whatever they do, beside one that is alone."""
    negative, least = 0, []
    for seed in range(20):
        random = np.random.default_rng(seed)
        few = draw_complex(random, 6, 2) + 0.1 * draw_complex(random, 300, 6, 2)
        ways = draw_complex(random, 2, 6) + 0.1 * draw_complex(random, 300, 2, 6)
        noise = Source("n", tuple(f"n {c}" for c in "abcdef"), FREQUENCY, ways, few @ few.conj().mT)
        coil = Source("coil", ("coil",), FREQUENCY, draw_complex(random, 300, 2, 1), np.array([[0.3]]))
        found = make_budget(RelativeError(1.0, "uniform"), [noise, coil], EDGES, resonances=RESONANCES)
        shares = np.array([found.contribution(line) for line in found.lines]) / found.variance
        assert shares.sum() == pytest.approx(1.0)
        assert shares.min() > -0.006  # in a band
        assert sorted(k for line in found.lines for k in line.channels) == list(range(7))
        assert (np.abs(found.correlation) < 1.0 + 1e-9).all()
        negative += int(found.pairs.sum(axis=(0, 1)).min() < -0.01 * found.variance)
        least += [shares.sum(axis=1).min(), (found.by_resonance / found.variance).min()]
    assert negative > 10  # budgets in which a channel by itself takes away
    verify_claim(
        "budget.shares_within_the_whole",
        claim="Shares of sources and resonances lie between 0 and 100 %, also of sources that cancel each other",
        where="`ps-fmu analyse budget`: terminal, budget.html and budget.json",
        reference="20 draws of six strongly correlated sources",
        error=-np.array(least),
        bound=1e-8,
    )


def test_lines_of_unknown_phase_have_a_mean_and_a_worst():
    """Three sines of one frequency, the first two in step: against the mean square over all phases of the third."""
    random = np.random.default_rng(4)
    ways, step_together = draw_complex(random, 1, 2, 3), 0.5 * np.array([[1, 1, 0], [1, 1, 0], [0, 0, 1]])
    source = Source("w", ("a", "b", "c"), np.array([3.0]), ways, step_together, lines=True, phases=("1", "1", "2"))
    found = make_budget(AbsoluteError(), [source], EDGES)
    phase = np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 3600, endpoint=False))
    answer = ways[0, :, 0] + ways[0, :, 1] + np.outer(phase, ways[0, :, 2])
    square = 0.5 * (np.abs(answer) ** 2).sum(axis=1)
    assert found.worst_rms > found.rms
    verify_claim(
        "budget.worst_phases",
        claim="Mean over the unknown phases of lines of one frequency, and the worst phases",
        where="`ps-fmu analyse budget` with wheels: RMS (worst phases)",
        reference="mean and largest of 3600 phases, one after the other",
        error=np.abs([found.variance / square.mean() - 1.0, found.worst_variance / square.max() - 1.0]),
        bound=1e-5,
    )
    with pytest.raises(ValueError, match="w, phases: expected 3, got 1"):
        Source("w", ("a", "b", "c"), np.array([3.0]), ways, step_together, lines=True, phases=("1",))


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
    plain = make_budget(index, sources, EDGES, step=STEP, resonances=RESONANCES)
    options = {"step": STEP, "resonances": RESONANCES}
    double = make_budget(index, sources, EDGES, **options, factors=UncertaintyFactors((), (2.0,)))
    assert double.pairs == pytest.approx(4.0 * plain.pairs, rel=1e-12)
    factors = UncertaintyFactors((5.0, 90.0), (2.0, 1.5, 7.0))
    found = make_budget(index, sources, EDGES, step=STEP, resonances=RESONANCES, factors=factors)
    scale = np.array([4.0, 4.0, 4.0, 2.25, 2.25])
    assert found.pairs == pytest.approx(scale[:, None, None] * plain.pairs, rel=1e-12)
    assert found.variance == pytest.approx(found.pairs.sum(), rel=1e-9)
    within = UncertaintyFactors((3.0,), (2.0, 1.0))
    found = make_budget(index, sources, EDGES, step=STEP, resonances=RESONANCES, factors=within)
    finer = make_budget(index, sources, np.insert(EDGES, 3, 3.0), step=STEP, resonances=RESONANCES).pairs
    assert found.pairs[2] == pytest.approx(4.0 * finer[2] + finer[3], rel=1e-9)
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
    model = StateSpace((A - np.eye(4)) / STEP, B / STEP, C, STEP)
    source = Source("s", ("x", "y", "z"), frequency, model.response(frequency), 2.0 * STEP * covariance)
    found = make_budget(index, [source], EDGES, step=STEP, resonances=find_resonances(model.poles, 50.0))
    assert found.variance == pytest.approx(exact, rel=1e-3)
    assert found.resonance_names == ("3 Hz", "8 Hz", "elsewhere")
    assert found.by_resonance.sum() == pytest.approx(found.variance, rel=1e-9)


@pytest.mark.parametrize("z", [1e-3, 0.02])
def test_a_mode_has_what_lies_in_its_resonance(z):
    """White noise of an oscillator: pi/2 of the half-power bandwidth times the height, 2/pi atan(10) of it within."""
    f = 3.0
    w = 2.0 * np.pi * f
    crowded = f * (1.0 + z * np.sinh(np.linspace(-8.0, 8.0, 4000)))
    frequency = np.unique(np.concatenate([np.linspace(0.1, 49.0, 2000), crowded]))
    frequency = frequency[(frequency >= 0.1) & (frequency <= 49.0)]
    model = StateSpace(np.array([[0.0, 1.0], [-w * w, -2.0 * z * w]]), np.array([[0.0], [w * w]]), np.eye(2)[:1])
    source = Source("s", ("s",), frequency, model.response(frequency), np.eye(1))
    found = make_budget(AbsoluteError(), [source], EDGES, resonances=find_resonances(model.poles, np.inf))
    assert found.variance == pytest.approx(np.pi * f / (4.0 * z), rel=0.01)
    assert found.resonance_names == ("3 Hz", "elsewhere")
    assert found.share(found.by_resonance[0]) == pytest.approx(2.0 / np.pi * np.arctan(10.0), abs=0.01)
    channel, low, high, share = found.dominant()
    assert (channel, low, high) == ("s", 2.0, 5.0)
    assert 0.9 < share <= 1.0


def test_two_modes_have_what_each_makes_alone():
    """In quadrature, in two signals: the steps of the cumulative spectrum, to what reaches over from the other."""
    f, z = np.array([3.0, 8.0]), 0.005
    w, zero = 2.0 * np.pi * f, np.zeros((2, 2))
    A = np.block([[zero, np.eye(2)], [-np.diag(w**2), -2.0 * z * np.diag(w)]])
    model = StateSpace(A, np.vstack([zero, np.diag(w**2)]), np.eye(4)[:2])
    crowded = f[:, None] * (1.0 + z * np.sinh(np.linspace(-5.0, 5.0, 2000)))
    frequency = np.unique(np.concatenate([np.linspace(0.1, 49.0, 2000), *crowded]))
    source = Source("s", ("one", "two"), frequency, model.response(frequency), np.eye(2))
    found = make_budget(AbsoluteError(), [source], EDGES, resonances=find_resonances(model.poles, np.inf))
    expected = 2.0 / np.pi * np.arctan(10.0) * np.pi * f / (4.0 * z)
    verify_claim(
        "budget.shares_of_resonances",
        claim="What lies in the resonance of a mode",
        where="`ps-fmu analyse budget`: table of resonances, by_resonance",
        reference="variance of an oscillator under white noise, pi f / (4 zeta), times 2/pi atan 10, for two modes",
        error=np.abs(found.by_resonance[:2] / expected - 1.0),
        bound=0.02,
    )


def record(time):
    """Two tones in two signals, the second 90 degrees behind, and noise in the first; an offset."""
    noise = np.random.default_rng(5).normal(0.0, 0.1, 200_000)[np.round(time / 1e-3).astype(int)]
    tones = np.stack([np.cos(2.0 * np.pi * 7.0 * time), 2.0 * np.sin(2.0 * np.pi * 7.0 * time)], axis=1)
    tones[:, 1] += 0.5 * np.cos(2.0 * np.pi * 31.4 * time)
    return tones + np.stack([3.0 + noise, np.zeros(len(time))], axis=1)


@pytest.mark.parametrize("repeats", [False, True])
def test_a_record_becomes_lines(repeats):
    """Frequencies, mean squares and phases of its tones; the noise has its variance in all other lines."""
    edges = np.concatenate([[0.0], np.geomspace(0.1, 500.0, 300)])
    frequency, squares = gather_lines(lambda rows: record(1e-3 * rows), 100_000, 1e-3, edges, repeats=repeats)
    assert len(frequency) < 300 and (np.diff(frequency) > 0.0).all()
    assert squares == pytest.approx(np.swapaxes(squares, 1, 2).conj(), abs=1e-12)
    seven, other = np.abs(frequency - 7.0).argmin(), np.abs(frequency - 31.4).argmin()
    assert frequency[[seven, other]] == pytest.approx([7.0, 31.4], abs=0.02)
    assert squares[seven] == pytest.approx(np.array([[0.5, 1.0j], [-1.0j, 2.0]]), abs=0.01)
    assert squares[other, 1, 1] == pytest.approx(0.125, abs=0.001)
    rest = np.delete(squares, seven, axis=0)[:, 0, 0].real.sum()
    assert rest == pytest.approx(0.01, rel=0.03)
    assert squares[:, 1, 1].real.sum() == pytest.approx(2.125, rel=1e-3)


def test_a_long_record_is_taken_in_segments(monkeypatch):
    monkeypatch.setattr(spectra, "_LONGEST", 20_000)
    for repeats in (False, True):
        found = gather_lines(lambda rows: record(1e-3 * rows), 100_000, 1e-3, EDGES[[0, 2, 5]], repeats=repeats)
        assert found[1][-1, 1, 1].real == pytest.approx(2.125, rel=1e-3)


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
