import os
from pathlib import Path

import pytest

from ps_fmu.runs.options import OptionError, RunOptions
from ps_fmu.runs.scenario import SCENARIOS

GOOD = {"scenario": SCENARIOS["isolation"], "system": Path("a.ssd"), "output": Path("results"), "duration_s": 20.0}


def test_defaults():
    options = RunOptions(**GOOD)
    assert options.step_s == 1e-4
    assert options.steps == 200_000
    assert options.storage_stride == 10
    assert options.seed == 1
    assert options.scheme == "jacobi"


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_each_default_duration_is_a_whole_number_of_steps(scenario):
    RunOptions(scenario, Path("a.ssd"), Path("results"), scenario.duration_s, scenario.step_s)


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=SCENARIOS)
def test_each_scenario_names_its_runs(scenario):
    assert len(scenario.find_cases()) == len(set(scenario.find_cases())) > 1


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"scheme": "newton"}, r"--scheme: expected one of jacobi, gauss-seidel"),
        ({"step_s": 0.0}, r"--step: expected a time above 0 s, got 0\.0"),
        ({"step_s": -1e-4}, r"--step: expected a time above 0 s"),
        ({"step_s": float("nan")}, r"--step: expected a time above 0 s, got nan"),
        ({"duration_s": -1.0}, r"--duration: expected a time above 0 s"),
        ({"duration_s": float("inf")}, r"--duration: expected a time above 0 s"),
        ({"duration_s": 5e-5}, r"--duration: 5e-05 s is not a whole number of steps of 0\.0001 s"),
        ({"duration_s": 1e300}, r"--duration: 1e\+300 s is longer than 1e\+06 s, 1e\+10 steps of 0\.0001 s"),
        ({"storage_step_s": 1.5e-4}, r"--storage-step: 0\.00015 s is not a whole number of steps"),
        ({"storage_step_s": 1e4}, r"--storage-step: 10000\.0 s is longer than the run of"),
        ({"seed": -1}, r"--seed: expected a whole number from 0 to 2147483647, got -1"),
        ({"seed": 2**31}, r"--seed"),
        ({"parameters": (Path("none.ssv"),)}, r"--parameters: there is no file none\.ssv"),
    ],
)
def test_impossible_options_are_named(changed, text):
    with pytest.raises(OptionError, match=text):
        RunOptions(**GOOD | changed)


@pytest.mark.parametrize(
    ("scenario", "step", "given", "stored"),
    [
        ("isolation", 1e-4, None, 1e-3),
        ("table2", 1e-4, None, 1e-2),
        ("slew", 1e-3, None, 1e-2),
        ("slew", 4e-3, None, 8e-3),  # the nearest whole number of steps
        ("isolation", 0.02, None, 0.02),
        ("isolation", 1e-4, 1e-4, 1e-4),
        ("table2", 1e-4, 0.5, 0.5),
    ],
)
def test_time_between_stored_rows(scenario, step, given, stored):
    options = RunOptions(**GOOD | {"scenario": SCENARIOS[scenario], "step_s": step, "storage_step_s": given})
    assert options.storage_s == pytest.approx(stored, rel=1e-12)
    assert options.storage_stride == round(stored / step)


def test_the_output_folder_is_made_and_left_empty(tmp_path):
    options = RunOptions(**GOOD | {"output": tmp_path / "a" / "b"}).claim_output()
    assert options.output == tmp_path / "a" / "b"
    assert os.listdir(options.output) == []


def test_an_output_that_is_a_file_is_refused(tmp_path):
    (tmp_path / "a").write_text("")
    with pytest.raises(OptionError, match=r"--output: cannot write in .*a: "):
        RunOptions(**GOOD | {"output": tmp_path / "a"}).claim_output()


def test_an_output_that_cannot_be_written_is_refused():
    """/proc takes no files, whoever asks."""
    with pytest.raises(OptionError, match="--output: cannot write in /proc"):
        RunOptions(**GOOD | {"output": Path("/proc/results")}).claim_output()
