"""Poles of delayed loops by Lambert's function, margins that all axes have in common, the structured singular value."""

from dataclasses import replace

import numpy as np
import pytest
from control import disk_margins, ss
from scipy.optimize import minimize
from scipy.special import lambertw
from support.claims import verify_claim

from ps_fmu.control.pointing import PointingLaw
from ps_fmu.mechanism.parameters import load
from ps_fmu.theory.line_of_sight import PointingLoop, Timing, find_loop_margins, find_margins
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.stability import (
    UnstableError,
    count_poles,
    describe_pole,
    describe_unstable,
    find_common_margins,
    find_growing,
    find_unstable,
    structured_value,
)
from ps_fmu.theory.transmissibility import from_base, from_wrench

GRID = np.geomspace(1e-4, 1e3, 150)  # Hz
TAU = 0.1  # s


def delayed_integrators(gains, s):
    """det(E + K exp(-s tau) / s) of three axes, without the integrators' poles at zero."""
    return np.prod([1.0 + gain * np.exp(-s * TAU) / s for gain in gains], axis=0) * (s / (s + 1.0)) ** len(gains)


def poles_by_lambert(gains):
    """s exp(s tau) = -k: s = W(-k tau) / tau, on all branches; those in the right half-plane."""
    found = np.array([lambertw(-gain * TAU, branch) / TAU for gain in gains for branch in range(-8, 8)])
    found = found[found.real > 0.0]
    return found[np.lexsort((-found.imag, -found.real))]


@pytest.mark.parametrize(
    "gains",
    [
        (10.0, 12.0, 15.7),  # below pi / (2 tau): stable
        (15.0, 15.72, 15.0),
        (15.7, 15.71, 15.72),  # three pairs within 0.006 rad/s, of which two have passed the axis
        (40.0, 100.0, 3.0),  # five pairs
        (200.0, 200.1, 200.2),
    ],
)
def test_poles_in_the_right_half_plane_are_those_of_lamberts_function(gains):
    expected = poles_by_lambert(gains)

    def characteristic(s):
        return delayed_integrators(gains, s)

    assert count_poles(characteristic, GRID) == len(expected)
    found = find_unstable(characteristic, GRID)
    verify_claim(
        "stability.poles",
        claim="Poles of an unstable loop in the right half-plane: how many, and where",
        where="refusal of every linear answer: `ps-fmu analyse budget`, `stability`, `ps-fmu run pointing`",
        reference="delayed integrators by Lambert's function, up to five pairs of poles and three within 0.006 rad/s",
        error=np.inf if len(found) != len(expected) else np.abs(found / expected - 1.0) if len(found) else 0.0,
        bound=1e-6,
    )
    if len(expected):
        for shift in (0.99, 1.01):
            line = shift * expected[0].real
            assert count_poles(characteristic, GRID, line) == np.sum(expected.real > line)


def test_pairs_close_together_and_to_the_axis_are_counted_from_few_points():
    """Turns alone miss them: three pairs of poles between two points of the curve turn it by a whole one."""
    random = np.random.default_rng(8)
    for _ in range(60):
        gains = 0.5 * np.pi / TAU * (1.0 + 2e-3 * random.uniform(-1.0, 1.0, 3))
        found = count_poles(lambda s, gains=gains: delayed_integrators(gains, s), np.geomspace(1e-3, 1e3, 40))
        assert found == len(poles_by_lambert(gains))


def test_a_real_pole_is_found_and_said():
    poles = find_unstable(lambda s: (s - 3.0) / (s + 1.0) * (s * s - 2.0 * s + 26.0) / (s + 1.0) ** 2, GRID)
    np.testing.assert_allclose(poles, [3.0, 1.0 + 5.0j, 1.0 - 5.0j], rtol=1e-8)
    assert describe_unstable(poles) == "a pole at +3 rad/s, and 2 more in the right half-plane"
    assert describe_pole(poles[1]) == "a pair of poles at +1 +/- 5i rad/s (0.8115 Hz, damping ratio -0.196)"


def test_what_rests_does_not_grow():
    poles = np.array([1e-9, 2.0 - 1.0j, -1.0, 2.0 + 1.0j, -np.inf])
    assert find_growing(poles).tolist() == [2.0 + 1.0j, 2.0 - 1.0j]


def turn(values, axes):
    """A loop with eigenvalues (3, n), whose axes (3, 3) are not at right angles."""
    return np.einsum("ij,jn,jk->nik", axes, values, np.linalg.inv(axes))


def test_margins_that_all_axes_have_in_common_are_those_of_the_eigenvalues():
    """k exp(-s tau) / s with three gains: pi / (2 k tau) in gain, (pi / 2 - k tau) / k in delay, of the largest."""
    gains = np.array([2.0, 3.0, 5.0])
    axes = np.random.default_rng(4).normal(size=(3, 3))

    def transfer(f):
        s = 2j * np.pi * f
        return turn(gains[:, None] * np.exp(-s * TAU) / s, axes)

    found = find_common_margins(transfer, np.geomspace(0.01, 30.0, 200))
    assert found.gain_db == pytest.approx(20.0 * np.log10(np.pi / (2.0 * 5.0 * TAU)), abs=1e-6)
    assert found.gain_hz == pytest.approx(0.25 / TAU, rel=1e-6)
    assert not found.lowers
    assert found.phase_deg == pytest.approx(90.0 - np.degrees(5.0 * TAU), abs=1e-6)
    assert found.delay_s == pytest.approx(np.pi / 10.0 - TAU, rel=1e-6)
    assert found.delay_hz == pytest.approx(5.0 / (2.0 * np.pi), rel=1e-6)


def test_a_gain_that_falls_may_be_the_nearer_edge():
    """k (s + 1)^2 / s^3 is stable from k = 1/2 on."""

    def transfer(f):
        s = 2j * np.pi * f
        return (0.6 * (s + 1.0) ** 2 / s**3)[:, None, None] * np.eye(2)

    found = find_common_margins(transfer, np.geomspace(0.01, 30.0, 400))
    assert found.lowers
    assert found.gain_db == pytest.approx(20.0 * np.log10(0.6 / 0.5), abs=1e-4)
    assert found.gain_hz == pytest.approx(1.0 / (2.0 * np.pi), rel=1e-4)


def test_the_structured_singular_value_of_matrices_that_have_a_closed_form():
    random = np.random.default_rng(2)
    for _ in range(20):
        a, b = random.normal(size=(2, 3)) + 1j * random.normal(size=(2, 3))
        assert structured_value(np.outer(a, b)) == pytest.approx(np.abs(a * b).sum(), rel=1e-6)
        triangle = np.triu(random.normal(size=(3, 3))) + 1j * np.triu(random.normal(size=(3, 3)))
        assert structured_value(triangle) == pytest.approx(np.abs(np.diag(triangle)).max(), rel=1e-2)


def test_the_disk_margin_of_one_axis_is_that_of_python_control():
    system = ss([[-1.0, -2.0], [1.0, 0.0]], [[3.0], [0.0]], [[0.5, 4.0]], 0.0)
    frequency = np.geomspace(0.01, 10.0, 2000)
    alpha, gain, phase = disk_margins(system, 2.0 * np.pi * frequency)
    found = find_common_margins(lambda f: np.moveaxis(np.atleast_3d(system(2j * np.pi * f, squeeze=False)), -1, 0),
                                frequency)  # fmt: skip
    assert found.disk == pytest.approx(alpha, rel=1e-4)
    assert found.disk_gain_db == pytest.approx(gain, rel=1e-3)
    assert found.disk_phase_deg == pytest.approx(phase, rel=1e-3)


def test_the_disk_margin_of_several_axes_is_that_of_the_worst_changes():
    """At the frequency of the peak: phases of changes as large as alpha that make the loop singular, none that is less.

    With (2 + d) / (2 - d) on each axis, det(E + L) is zero where det(E + D (S - E / 2)) is, D of the d.
    """
    axes = np.random.default_rng(7).normal(size=(3, 3))

    def transfer(f):
        s = 2j * np.pi * f
        return turn(np.array([[2.0], [3.0], [5.0]]) * np.exp(-s * TAU) / s, axes)

    found = find_common_margins(transfer, np.geomspace(0.01, 30.0, 300))
    L = transfer(np.array([found.disk_hz]))[0]

    def distance(size):
        def of(phases):
            d = size * np.exp(1j * phases)
            return float(np.linalg.svd(np.eye(3) + np.diag((2.0 + d) / (2.0 - d)) @ L, compute_uv=False)[-1])

        starts = np.random.default_rng(1).uniform(0.0, 2.0 * np.pi, (30, 3))
        return min(minimize(of, start, method="Nelder-Mead").fun for start in starts)

    verify_claim(
        "stability.disk_margin",
        claim="Disk margin of a loop: gain and phase of each axis by itself, all at the same time",
        where="`ps-fmu run pointing`, `ps-fmu analyse stability`: margins",
        reference="the least singular value of the changed loop, by a search over the phases of the changes",
        error=distance(found.disk) / distance(0.9 * found.disk),
        bound=1e-3,
    )
    assert found.disk_gain_db < found.gain_db
    assert found.disk_phase_deg < found.phase_deg


PAPER = load()
SPLIT = replace(PAPER, filters=replace(PAPER.filters, highpass_frequency=0.02))  # Hz
TIMING = Timing(sample_time=0.01, latency=0.01, step=1e-4)


def make_pointing(gain_db=0.0, delay_s=0.0):
    law = PointingLaw.from_parameters(SPLIT)
    design = replace(law.loop, crossover_frequency=law.loop.crossover_frequency * 10.0 ** (gain_db / 20.0))
    control = law.with_design(design).controller(np.zeros(3))
    return PointingLoop(loop_at(SPLIT, delay=1.5e-4), control, replace(TIMING, control_delay=delay_s))


def test_the_line_of_sight_loop_is_unstable_beyond_its_common_margins_and_stable_within():
    """Poles are counted, margins read from eigenvalues of the open loop: two ways to the same edge."""
    found = find_loop_margins(make_pointing())
    assert found.gain_db == pytest.approx(8.70, abs=0.01)
    assert found.gain_hz == pytest.approx(5.48, abs=0.01)
    assert found.delay_s == pytest.approx(0.1075, abs=1e-4)
    assert 7.0 < found.disk_gain_db < found.gain_db
    for share in (0.999, 1.001):
        louder, later = make_pointing(gain_db=share * found.gain_db), make_pointing(delay_s=share * found.delay_s)
        assert (len(louder.unstable) == 2, len(later.unstable) >= 2) == (share > 1.0, share > 1.0)
    assert louder.unstable[0].imag == pytest.approx(2.0 * np.pi * found.gain_hz, rel=1e-2)
    assert later.unstable[0].imag == pytest.approx(2.0 * np.pi * found.delay_hz, rel=1e-2)


def test_no_response_of_an_unstable_isolator():
    late = loop_at(load(bus="LSM"), delay=0.1)
    for answer in (from_base, from_wrench):
        assert np.isfinite(answer(late, np.array([1j]), active=False)).all()
        with pytest.raises(UnstableError, match=r"delay of 0\.1 s: .* \(5\.745 Hz, damping ratio -0\.0118\)") as caught:
            answer(late, np.array([1j]), active=True)
    poles = caught.value.poles
    np.testing.assert_allclose(poles, late.poles()[: len(poles)], rtol=1e-8)


def count_with_gains(pointing, gains):
    """Poles in the right half-plane with a gain of its own on each axis."""

    def characteristic(s):
        outer = np.linalg.det(np.eye(3) + pointing.transfer(s) * np.asarray(gains))
        return outer * pointing.loop.characteristic(s) * (s / (s + 1.0)) ** 6

    return count_poles(characteristic, np.geomspace(1e-5, 1e4, 300))


def test_margins_of_one_axis_are_edges_while_the_others_stay():
    pointing = make_pointing()
    worst = 0.0
    for axis, margins in enumerate(find_margins(pointing)):
        for share in (0.999, 1.001):
            gains = np.ones(3)
            gains[axis] = 10.0 ** (share * margins.gain_db / 20.0)
            assert (count_with_gains(pointing, gains) > 0) == (share > 1.0)
        worst = max(worst, 0.001 * margins.gain_db)
    verify_claim(
        "stability.margins_of_an_axis",
        claim="Gain margin of one axis of the line-of-sight loop, the others closed",
        where="`ps-fmu run pointing`, `ps-fmu analyse stability`: table of margins",
        reference="poles of the loop with the gain of this axis 0.1 % of the margin below and above it, counted",
        error=worst,
        bound=0.02,
        unit="dB",
    )


def test_gains_within_the_disk_keep_the_loop_stable_and_one_beyond_its_edge_does_not():
    pointing = make_pointing()
    common = find_loop_margins(pointing)
    random = np.random.default_rng(5)
    for exponents in (*random.uniform(-1.0, 1.0, (12, 3)), *random.choice([-1.0, 1.0], (6, 3))):
        assert count_with_gains(pointing, 10.0 ** (exponents * common.disk_gain_db / 20.0)) == 0
    assert count_with_gains(pointing, np.full(3, 10.0 ** ((common.gain_db + 0.02) / 20.0))) == 2


def test_margins_that_the_readme_of_the_controller_states():
    """At yaw 14 deg, where they are least of both buses and the orientations of Table 2."""
    orientation = np.radians([0.0, 0.0, 14.0])

    def make(ratio):
        law = PointingLaw.from_parameters(SPLIT)
        frequencies = ("crossover_frequency", "integral_frequency", "rolloff_frequency")
        design = replace(law.loop, **{name: ratio * getattr(law.loop, name) for name in frequencies})
        return PointingLoop(
            loop_at(SPLIT, orientation, 1.5e-4), law.with_design(design).controller(orientation), TIMING
        )

    axes, common = find_margins(make(1.0)), find_loop_margins(make(1.0))
    assert min(axis.gain_db for axis in axes) == pytest.approx(9.6, abs=0.05)
    assert min(axis.phase_deg for axis in axes) == pytest.approx(50.7, abs=0.05)
    assert common.gain_db == pytest.approx(7.5, abs=0.05)
    assert common.phase_deg == pytest.approx(50.7, abs=0.05)
    assert common.delay_s == pytest.approx(0.107, abs=5e-4)
    assert (common.disk_gain_db, common.disk_phase_deg) == pytest.approx((6.5, 39.0), abs=0.5)
    assert find_loop_margins(make(1.35 / 1.25)).gain_db == pytest.approx(6.0, abs=0.1)
