"""Responses of linear models against closed forms, and their resonances."""

import numpy as np
import pytest

from ps_fmu.pointing.modal import StateSpace, find_resonances

FREQUENCY = np.geomspace(0.01, 40.0, 400)  # Hz


def oscillator(frequency, damping):
    """x'' + 2 z w x' + w^2 x = u, with the states x and x'."""
    w = 2.0 * np.pi * frequency
    return np.array([[0.0, 1.0], [-w * w, -2.0 * damping * w]])


def blocks(*matrices):
    """Several systems of two states, all driven by the input and added up."""
    n = len(matrices)
    A = np.zeros((2 * n, 2 * n))
    for k, matrix in enumerate(matrices):
        A[2 * k : 2 * k + 2, 2 * k : 2 * k + 2] = matrix
    return A, np.tile([[0.0], [1.0]], (n, 1)), np.tile([[1.0, 0.0]], (1, n))


def alone(frequency, damping, f=FREQUENCY):
    s, w = 2j * np.pi * f, 2.0 * np.pi * frequency
    return 1.0 / (s * s + 2.0 * damping * w * s + w * w)


def list_poles(*pairs):
    """Of oscillators with a frequency, Hz, and a damping ratio, and their conjugates."""
    poles = np.array([2.0 * np.pi * f * (-z + 1j * np.sqrt(1.0 - z * z)) for f, z in pairs])
    return np.concatenate([poles, poles.conj(), [-3.0, -np.inf]])


def test_a_resonance_reaches_ten_half_widths():
    found = find_resonances(list_poles((5.0, 0.02), (40.0, 0.001), (12.0, 0.3)), 100.0)
    assert [each.name for each in found] == ["5 Hz", "40 Hz"]  # 12 Hz has too much damping
    limits = [(each.low, each.high) for each in found]
    assert limits == [pytest.approx((4.0, 6.0)), pytest.approx((39.6, 40.4))]
    assert find_resonances(list_poles((5.0, 0.02)), 4.0) == ()
    assert find_resonances(list_poles((5.0, 0.02)), 5.5)[0].high == 5.5


def test_modes_that_a_spectrum_does_not_tell_apart_are_one():
    """Half-widths of 0.1 Hz: nearer than 0.6 Hz they are one.  Six equal poles are one, too."""
    (both,) = find_resonances(list_poles((5.0, 0.02), (5.5, 0.02)), 100.0)
    assert (both.name, both.low, both.high) == ("5 to 5.5 Hz", pytest.approx(4.0), pytest.approx(6.6))
    (six,) = find_resonances(list_poles(*[(0.035, 0.05)] * 6), 100.0)
    assert six.name == "0.035 Hz"
    apart = find_resonances(list_poles((5.0, 0.02), (5.7, 0.02)), 100.0)
    assert [each.name for each in apart] == ["5 Hz", "5.7 Hz"]
    assert apart[0].high == apart[1].low == pytest.approx((5.0 * 0.114 + 5.7 * 0.1) / 0.214)


def test_resonances_do_not_overlap():
    random = np.random.default_rng(2)
    for _ in range(50):
        pairs = zip(random.uniform(0.1, 90.0, 30), random.uniform(1e-4, 0.2, 30), strict=True)
        found = find_resonances(list_poles(*pairs), 80.0)
        limits = np.array([(each.low, each.high) for each in found]).reshape(-1)
        assert (np.diff(limits) >= 0.0).all() and limits[-1] <= 80.0


@pytest.mark.parametrize("step", [1e-3, 1e-5])
def test_discrete_time_and_direct_action(step):
    """A held input, a delay of one step, and feedthrough; far below the sampling rate, too."""
    w, z = 2.0 * np.pi * 5.0, 0.02
    damped = w * np.sqrt(1.0 - z * z)
    decay, turn = np.exp(-z * w * step), damped * step
    Ad = decay * np.array(
        [
            [np.cos(turn) + z * w / damped * np.sin(turn), np.sin(turn) / damped],
            [-w * w / damped * np.sin(turn), np.cos(turn) - z * w / damped * np.sin(turn)],
        ]
    )
    Bd = np.linalg.solve(oscillator(5.0, z), (Ad - np.eye(2)) @ [[0.0], [1.0]])
    A = np.zeros((3, 3))
    A[:2, :2], A[:2, 2:], A[2, 2] = (Ad - np.eye(2)) / step, Bd / step, -1.0 / step
    model = StateSpace(A, np.array([[0.0], [0.0], [1.0 / step]]), np.array([[1.0, 0.0, 0.0]]), step, np.array([[1e-3]]))
    turned = np.exp(2j * np.pi * FREQUENCY * step)
    expected = 1e-3 + np.array([(np.linalg.solve(q * np.eye(2) - Ad, Bd) / q)[0, 0] for q in turned])
    assert model.response(FREQUENCY)[:, 0, 0] == pytest.approx(expected, rel=1e-8)
    own = model.poles[model.poles.imag > 1.0]
    assert np.abs(own) / (2.0 * np.pi) == pytest.approx([5.0], rel=1e-7)
    assert -own.real / np.abs(own) == pytest.approx([z], rel=1e-5)
    assert (model.poles.real < -30.0 / step).sum() == 1  # the delay: -inf, but for rounding


def test_a_free_body_keeps_its_digits_far_below_the_sampling_rate():
    """1/f^2 beside a pole of 1 kHz, at a millionth of the sampling rate."""
    A, B, C = blocks(oscillator(0.0, 0.0), oscillator(1000.0, 0.5))
    found = StateSpace(A, B, C, 1e-4).response(np.array([1e-2]))[0, 0, 0]
    point = np.expm1(2j * np.pi * 1e-6) / 1e-4
    assert found == pytest.approx(1.0 / point**2, rel=1e-8)


def test_what_does_not_fit_is_refused():
    A, B, C = blocks(oscillator(5.0, 0.02))
    with pytest.raises(ValueError, match="do not fit each other"):
        StateSpace(A, B, C[:, :1])
    with pytest.raises(ValueError, match="step: expected 0 s"):
        StateSpace(A, B, C, -1.0)
    with pytest.raises(ValueError, match="from 0 to 50 Hz"):
        StateSpace(A, B, C, 0.01).response(np.array([51.0]))
    with pytest.raises(ValueError, match=r"expected values \(n,\)"):
        StateSpace(A, B, C).response(np.ones((2, 2)))
