"""Recorded disturbances: interpolation, and files that are not what they should be."""

import numpy as np
import pytest
from support.claims import verify_claim

from ps_fmu.disturbance import Disturbance, default_settings, recording
from ps_fmu.mechanism.parameters import ParameterError, load
from ps_fmu.mechanism.quantities import replace_values

HEADER = ",".join(recording.HEADER)


@pytest.fixture
def write(tmp_path):
    """Writes lines below the header into a file."""

    def write(*lines, header=HEADER):
        path = tmp_path / "wrench.csv"
        path.write_text("\n".join([header, *lines, ""]))
        return path

    return write


def test_linear_interpolation_and_nothing_outside(write):
    path = write("1.0,9,0,0,0,0,0", "2.0,1,2,3,4,5,6", "", "4.0,3,0,0,0,0,6")
    found = recording.Recording(path, scale=2.0)
    wrench = found(np.array([0.0, 1.0 - 1e-6, 1.0, 1.5, 2.0, 3.0, 4.0, 4.0 + 1e-6, 9.0]))
    np.testing.assert_allclose(wrench[:, 0], 2.0 * np.array([0.0, 0.0, 9.0, 5.0, 1.0, 2.0, 3.0, 0.0, 0.0]))
    np.testing.assert_allclose(wrench[:, 5], 2.0 * np.array([0.0, 0.0, 0.0, 3.0, 6.0, 6.0, 6.0, 0.0, 0.0]))
    assert (found.end, recording.Recording(path, repeat=True).end) == (4.0, np.inf)


def test_the_last_line_acts_at_a_time_that_is_a_sum_of_steps(write):
    path = write("0,1,0,0,0,0,0", "0.3,1,0,0,0,0,0")
    times = np.arange(1, 5) * 0.1  # 0.1 * 3 is above 0.3
    assert times[2] > 0.3
    np.testing.assert_array_equal(recording.Recording(path)(times)[:, 0], [1.0, 1.0, 1.0, 0.0])


def test_what_has_ended_is_said(write):
    path = write("0,1,0,0,0,0,0", "2.5,1,0,0,0,0,0")
    settings = replace_values(default_settings(load()), {"noise.enabled": False, "recording.path": str(path)})
    assert Disturbance(settings).explain_end(2.5) == []
    (text,) = Disturbance(settings).explain_end(7.0)
    assert text == "recording: ends at 2.5 s, and nothing of it acts from there to 7 s"
    assert Disturbance(replace_values(settings, {"recording.repeat": True})).explain_end(7.0) == []
    died_away = write("0,0,0,0,0,0,0", "1,1,0,0,-3,0,0", "2.5,1e-12,0,0,0,0,0")
    assert Disturbance(replace_values(settings, {"recording.path": str(died_away)})).explain_end(7.0) == []


def test_repetition(write):
    path = write("1.0,0,0,0,0,0,0", "2.0,1,0,0,0,0,0", "3.0,0,0,0,0,0,0")
    wrench = recording.Recording(path, repeat=True)(np.array([0.5, 1.5, 3.5, 5.25, 101.0]))
    np.testing.assert_allclose(wrench[:, 0], [0.5, 0.5, 0.5, 0.25, 0.0])


def test_columns_in_any_order_and_others_beside_them(write):
    header = "comment,torque.z [N.m],torque.y [N.m],torque.x [N.m],force.z [N],force.y [N],force.x [N],time  [s]"
    path = write("first,6,5,4,3,2,1,0", "second,6,5,4,3,2,1,1", header=header)
    np.testing.assert_array_equal(recording.Recording(path)(np.array([0.5]))[0], [1, 2, 3, 4, 5, 6])


def test_many_lines(write):
    path = write(*(f"{i / 1000},{i},0,0,0,0,0" for i in range(5000)))
    np.testing.assert_allclose(recording.Recording(path)(np.array([4.9985]))[0, 0], 4998.5)


# --- Drift ------------------------------------------------------------------------------


@pytest.fixture
def tones(write):
    """Three sines over 20 s that begin at full amplitude: a free body keeps a mean velocity."""
    time = np.arange(20_001) * 1e-3
    size = np.array([1.0, -0.5, 2.0, 0.1, 0.2, -0.3])
    angle = 2.0 * np.pi * np.outer(time, (0.93, 5.23, 31.1)) + np.array([1.0, 2.0, 0.5])
    rows = np.column_stack([time, np.outer(np.sin(angle).sum(axis=1), size)])
    return write(*(",".join(f"{value:.12g}" for value in row) for row in rows))


def move(recording, duration, step=5e-4):
    """Velocity and place of a free body of mass and inertia one, (n, 6)."""
    times = np.arange(round(duration / step) + 1) * step
    wrench = recording(times)
    zero = np.zeros((1, 6))
    velocity = np.vstack([zero, np.cumsum(0.5 * step * (wrench[1:] + wrench[:-1]), axis=0)])
    return velocity, np.vstack([zero, np.cumsum(0.5 * step * (velocity[1:] + velocity[:-1]), axis=0)])


def test_the_impulses_of_a_constant_force(write):
    """By hand: F t, and F t^2 / 2; after the end it coasts; where it repeats it goes on."""
    path = write("1,2,0,0,0,0,0.5", "3,2,0,0,0,0,0.5")
    for repeat, end, first, second in ((False, 3.0, 4.0, 4.0), (False, 5.0, 4.0, 12.0), (True, 5.0, 10.0, 25.0)):
        found = recording.Recording(path, repeat).integrate(end)
        np.testing.assert_allclose(found.first[[0, 5]], [first, first / 4.0])
        np.testing.assert_allclose(found.second[[0, 5]], [second, second / 4.0])


@pytest.mark.parametrize("repeat", [False, True])
@pytest.mark.parametrize("overlap", [0.0, 1.5])
def test_no_drift_without_trend(tones, repeat, overlap):
    """A free body stays where the sines swing it, from the first row on, over any number of repetitions.

    As it is it goes away: by its mean velocity, and by a kick at each wrap.
    """
    duration = 90.0 if repeat else 30.0
    as_is = recording.Recording(tones, repeat, overlap=overlap)
    steady = recording.Recording(tones, repeat, overlap=overlap, detrend=True, fade_in=2.0)
    _, place = move(as_is, duration)
    velocity, still = move(steady, duration)
    swing = 1.2 * np.array([1.0, 0.5, 2.0, 0.1, 0.2, 0.3]) / (2.0 * np.pi * 0.93) ** 2  # the slowest sine makes most
    assert (np.abs(place[-1]) > 30.0 * swing).all()
    bound = 8.0 if repeat else 1.5  # sines that a wrap breaks have low frequencies, too
    assert (np.abs(still).max(axis=0) < bound * swing).all()
    np.testing.assert_allclose(as_is.integrate(duration).second, place[-1], rtol=0.02)  # jumps
    if not repeat:
        assert np.abs(velocity[-1]).max() < 1e-6
        middle = np.arange(5000, 15_000) * 1e-3
        np.testing.assert_allclose(steady(middle), as_is(middle), atol=0.01)  # a constant is taken away
    verify_claim(
        "noise.recording_detrend",
        claim="A recording with `detrend` moves a free body, but leaves no drift",
        where="`disturbance.recording.detrend`",
        reference="motion of a free body over 30 s, or 90 s with repetitions, over that with drift at the end",
        error=(np.abs(still).max(axis=0) / np.abs(place[-1])).max(),
        bound=0.1,
    )


def test_a_wrap_without_kick(tones):
    """The momentum before and after a wrap is the same, and nothing jumps."""
    steady = recording.Recording(tones, True, overlap=1.5, detrend=True, fade_in=2.0)
    period = steady.span[1] - steady.span[0]
    assert period == pytest.approx(18.5)
    velocity, _ = move(steady, 4.0 * period)
    samples = np.round(period / 5e-4 * np.array([2.0, 3.0, 4.0])).astype(int)
    np.testing.assert_allclose(velocity[samples[1:]], velocity[samples[:1]].repeat(2, axis=0), atol=2e-4)
    np.testing.assert_allclose(steady.jump, 0.0, atol=1e-12)
    plain = recording.Recording(tones, True)
    assert np.abs(plain.jump).max() > 0.5
    cross = steady(np.array([2.0 * period - 1e-6, 2.0 * period + 1e-6]))
    np.testing.assert_allclose(cross[0], cross[1], atol=1e-3)


def test_an_overlap_keeps_the_power_of_noise(write):
    random, time = np.random.default_rng(2), np.arange(20_001) * 1e-3
    path = write(*(f"{t:.4f},{f:.6f},0,0,0,0,0" for t, f in zip(time, random.normal(size=len(time)), strict=True)))
    steady = recording.Recording(path, True, overlap=8.0)
    assert np.std(steady(np.arange(8000) * 1e-3)[:, 0]) == pytest.approx(1.0, abs=0.03)


def test_a_fade_in(write):
    path = write("0,1,0,0,0,0,0", "5,1,0,0,0,0,0", "6,1,0,0,0,0,0")
    with pytest.raises(ParameterError, match=r"overlap: expected at most half of the recording of 6 s, got 4 s"):
        recording.Recording(path, True, overlap=4.0)
    path = write(*(f"{t / 100},1,0,0,0,0,0" for t in range(1001)))
    found = recording.Recording(path, fade_in=2.0)(np.array([0.0, 1.0, 2.0, 9.0]))[:, 0]
    np.testing.assert_allclose(found, [0.0, 0.5, 1.0, 1.0], atol=1e-12)


def test_a_file_is_read_once_until_it_changes(write, monkeypatch):
    read, count = recording._read_lines, []
    monkeypatch.setattr(recording, "_read_lines", lambda *given: count.append(1) or read(*given))
    path = write("0,1,0,0,0,0,0", "1,1,0,0,0,0,0")
    for _ in range(3):
        recording.Recording(path)
    assert len(count) == 1
    write("0,1,0,0,0,0,0", "1,2,0,0,0,0,0", "2,2,0,0,0,0,0")
    assert recording.Recording(path)(np.array([1.0]))[0, 0] == 2.0
    assert len(count) == 2


GOOD = ("0,0,0,0,0,0,0", "1,0,0,0,0,0,0")


@pytest.mark.parametrize(
    ("lines", "header", "problem"),
    [
        (GOOD, HEADER.replace("force.y [N]", "force.y [mN]"), r"line 1: column 'force.y \[mN\]' must be 'force.y"),
        (GOOD, HEADER.replace("torque.x [N.m]", "spin"), r"line 1: no column 'torque.x \[N.m\]'"),
        (GOOD, HEADER.replace("force.y", "force.x"), r"line 1: two columns 'force.x \[N\]'"),
        (GOOD, "", r"line 1: no column 'time \[s\]'"),
        (("0,0,0,0,0,0,0", "1,0,0,abc,0,0,0"), HEADER, r"line 3: could not convert string 'abc' to float64"),
        (("0,0,0,0,0,0,0", "1,0,0,inf,0,0,0"), HEADER, r"line 3: 'force.z \[N\]': must be finite"),
        (("0,0,0,0,0,0,0", "1,0,0"), HEADER, r"line 3: .*3 columns"),
        (("0,0,0,0,0,0,0", "0,0,0,0,0,0,0"), HEADER, r"line 3: the time 0 s does not come after 0 s"),
        (("0,0,0,0,0,0,0", "nan,0,0,0,0,0,0"), HEADER, r"line 3: 'time \[s\]': must be finite"),
        (("0,0,0,0,0,0,0",), HEADER, "has 1 lines of numbers"),
        (("0," + "0" * 5000 + ",0,0,0,0,0",), HEADER, "line 2: longer than 4096 characters"),
        (('0,"0,0,0,0,0,0',), HEADER, "line 2: "),
    ],
)  # fmt: skip
def test_files_that_cannot_be_used(write, lines, header, problem):
    with pytest.raises(ParameterError, match=problem) as refusal:
        recording.Recording(write(*lines, header=header))
    assert str(refusal.value).startswith("path: ")


def test_no_file_a_folder_no_text(tmp_path):
    for path in (tmp_path / "missing.csv", tmp_path):
        with pytest.raises(ParameterError, match="no file"):
            recording.Recording(path)
    binary = tmp_path / "binary.csv"
    binary.write_bytes(bytes(range(256)) * 10)
    with pytest.raises(ParameterError, match=r"binary\.csv"):
        recording.Recording(binary)


def test_limits_of_size(write, monkeypatch):
    path = write(*(f"{i},0,0,0,0,0,0" for i in range(20)))
    monkeypatch.setattr(recording, "MAX_ROWS", 10)
    with pytest.raises(ParameterError, match="line 12: more than 10 lines"):
        recording.Recording(path)
    monkeypatch.setattr(recording, "MAX_BYTES", 100)
    with pytest.raises(ParameterError, match="at most 100 are read"):
        recording.Recording(path)
