import json
import math
import os
import re
from dataclasses import fields
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ps_fmu.cosim.isolation.instance import Isolation
from ps_fmu.cosim.schemes.scheme import EXTRAPOLATIONS, METHODS, ORDERS, Iteration, Rate, Scheme
from ps_fmu.runs import origin
from ps_fmu.runs.options import OptionError, RunOptions, from_json, name_option, to_json
from ps_fmu.runs.scenario import PLAIN, SCENARIOS

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


TEXTS = st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1, max_size=6)
TIMES = st.floats(1e-9, 1e3)
SCHEMES = st.one_of(
    st.sampled_from(ORDERS),
    st.builds(
        Scheme, st.sampled_from(ORDERS[:2]), st.sampled_from(EXTRAPOLATIONS),
        st.dictionaries(TEXTS, st.builds(Rate, st.integers(1, 99)) | st.builds(Rate, parts=st.integers(1, 99))),
        st.builds(Iteration, st.sampled_from(METHODS), st.floats(1e-12, 0.5)), st.booleans(),
    ),
)  # fmt: skip
FILES = st.one_of(st.none(), st.just(Path(__file__)))
OPTIONS = st.builds(
    RunOptions,
    scenario=st.just(PLAIN),
    system=st.just(Path(__file__)),
    output=st.just(Path("/results")),
    duration_s=st.just(math.nan),
    step_s=TIMES,
    seed=st.one_of(st.none(), st.integers(0, 2**31 - 1)),
    parameters=st.lists(st.just(Path(__file__)), max_size=2).map(tuple),
    values=st.dictionaries(TEXTS, st.one_of(st.booleans(), st.integers(-9, 9), TIMES, TEXTS), max_size=3),
    apart=st.lists(TEXTS, max_size=2).map(tuple),
    scheme=SCHEMES,
    requirements=FILES,
    disturbance=FILES,
    inputs=FILES,
    outside=st.booleans(),
    profile=st.booleans(),
    observe=st.lists(TEXTS, max_size=2).map(tuple),
    figures=st.booleans(),
    isolation=st.one_of(st.none(), st.builds(Isolation, st.one_of(st.none(), st.frozensets(TEXTS)), TIMES)),
    faults=FILES,
    checkpoint_s=st.one_of(st.none(), TIMES),
    source=FILES,
)


@settings(max_examples=50, deadline=None)
@given(OPTIONS)
def test_options_are_the_same_after_json(options):
    """Types, too: True is no 1, and 1 no 1.0."""
    again = from_json(json.loads(json.dumps(to_json(options))), PLAIN, options.output)
    assert again == options
    assert [type(value) for value in again.values.values()] == [type(value) for value in options.values.values()]


def test_the_command_forgets_no_option():
    """But those that change no number."""
    given_options = {
        "seed": 5, "parameters": (Path(__file__),), "apart": ("a",), "scheme": Scheme("gauss-seidel"),
        "storage_step_s": 1e-3, "requirements": Path(__file__), "disturbance": Path(__file__), "outside": True,
        "inputs": Path(__file__), "observe": ("x",), "isolation": Isolation(), "faults": Path(__file__),
        "replace": {"isolator": Path(__file__)}, "source": Path(__file__), "anew": ("b",), "duration_s": 2.0,
        "step_s": 2e-4, "instrument": Path(__file__),
    }  # fmt: skip
    left_out = {one.name for one in fields(RunOptions)} - given_options.keys()
    assert left_out == set(origin._NO_COMMAND)
    words = origin.format_command(RunOptions(**GOOD | given_options))
    for name in given_options:
        assert re.search(rf"{name_option(name)}( |$)", words), name


def test_what_is_no_option_is_named():
    found = to_json(RunOptions(**GOOD))
    for change, reason in (({"step_s": "fast"}, "step_s: Expected `float`"), ({"seed": True}, "seed: Expected `int")):
        with pytest.raises(ValueError, match=reason):
            from_json({**found, **change}, SCENARIOS["isolation"], Path("results"))
    with pytest.raises(ValueError, match="faults: "):
        from_json({name: value for name, value in found.items() if name != "faults"}, PLAIN, Path("results"))
