"""Recorded disturbances: interpolation, and files that are not what they should be."""

import numpy as np
import pytest

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
