"""Responses by mode: against closed forms, their sum, and modes that cannot be told apart."""

import numpy as np
import pytest

from ps_fmu.pointing.modal import REST, Mode, StateSpace

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


def test_one_mode_is_all_there_is():
    model = StateSpace(*blocks(oscillator(5.0, 0.02)))
    found = model.modal_response(FREQUENCY)
    assert found.names == ("5 Hz", REST)
    assert found.modes[0].damping == pytest.approx(0.02)
    assert found.parts[0, :, 0, 0] == pytest.approx(alone(5.0, 0.02), rel=1e-12)
    assert np.abs(found.parts[1]).max() < 1e-12 * np.abs(found.parts[0]).max()


def test_modes_rigid_motion_and_filters():
    """A free body, which has no eigenvectors of its own, and a filter with much damping make the rest."""
    model = StateSpace(*blocks(oscillator(5.0, 0.02), oscillator(0.0, 0.0), oscillator(12.0, 0.01), oscillator(3, 0.7)))
    found = model.modal_response(FREQUENCY)
    assert [round(mode.frequency, 9) for mode in found.modes] == [5.0, 12.0]
    assert found.parts[0, :, 0, 0] == pytest.approx(alone(5.0, 0.02), rel=1e-9)
    assert found.parts[1, :, 0, 0] == pytest.approx(alone(12.0, 0.01), rel=1e-9)
    rest = alone(0.0, 0.0) + alone(3.0, 0.7)
    assert found.parts[2, :, 0, 0] == pytest.approx(rest, rel=1e-9, abs=1e-12 * np.abs(rest).max())
    whole = model.response(FREQUENCY)
    assert found.parts.sum(axis=0) == pytest.approx(whole, rel=1e-14)


def test_modes_of_nearly_one_frequency_have_names_of_their_own():
    """Four that three digits do not tell apart, of which four digits tell apart two."""
    model = StateSpace(*blocks(*(oscillator(f, 0.02) for f in (486.12, 486.98, 485.5, 485.53, 12.345))))
    names = StateSpace(model.A, model.B, model.C).modal_response([1.0], apart=1e-6).names
    assert names == ("12.3 Hz", "485.5 Hz", "485.53 Hz", "486.1 Hz", "487 Hz", REST)


def test_modes_that_cannot_be_told_apart_are_one():
    A, B, C = blocks(oscillator(5.0, 0.02), oscillator(5.0001, 0.02), oscillator(6.0, 0.02))
    A[3, 0] = 1.0  # one drives the other: together they are nearly a multiple pole
    found = StateSpace(A, B, C).modal_response(FREQUENCY)
    assert found.names == ("5 Hz", "6 Hz", REST)
    assert np.abs(found.parts[0]).max() < 1e3 * np.abs(found.parts.sum(axis=0)).max()
    near = StateSpace(A, B, C).modal_response(FREQUENCY, apart=1e-6)
    assert [mode.name for mode in near.modes] == ["5 Hz", "5 Hz", "6 Hz"]
    assert near.parts[:2].sum(axis=0) == pytest.approx(found.parts[0], rel=1e-6)


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
    found = model.modal_response(FREQUENCY)
    assert model.response(FREQUENCY)[:, 0, 0] == pytest.approx(expected, rel=1e-8)
    assert found.modes == (Mode(pytest.approx(5.0, rel=1e-7), pytest.approx(z, rel=1e-5)),)
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
        StateSpace(A, B, C).modal_response(np.ones((2, 2)))
