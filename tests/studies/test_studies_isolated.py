"""Studies whose FMUs have processes of their own: the same rows, and a case that breaks its FMU costs nothing more."""

import re

import pytest

from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.rows import DONE, FAILED, KILLED
from ps_fmu.studies.worker import CaseProcess

GAIN = {"toy.gain": 1.5}


@pytest.fixture
def unpack(make_prepared, tmp_path):
    """Makes the unpacked files of a study of the toy, with these lines more in [study]."""
    return lambda *more: make_prepared(changes={"seed = 7": "\n".join(["seed = 7", *more])}).bundle.unpack(tmp_path)


@pytest.fixture
def isolate(unpack):
    """Makes a process for the cases of a study with isolated FMUs; with these lines more in [study]."""
    made = []

    def make(*more):
        made.append(CaseProcess(unpack("isolate = true", *more), memory_bytes=1_000_000_000, isolates=True))
        return made[-1]

    yield make
    for process in made:
        process.close()


def strip(rows):
    """What another run of the same cases has, too."""
    return [{name: value for name, value in row.items() if name != "wall_s"} for row in rows]


def test_rows_are_those_of_the_same_process(unpack, isolate):
    cases = [{**GAIN, "toy.seed": seed} for seed in (1, 2)]
    plain = CaseRunner(unpack())
    assert strip(isolate().run(enumerate(cases))) == strip(plain.run(place, own) for place, own in enumerate(cases))


@pytest.mark.parametrize(
    ("mode", "more", "error"),
    [
        ("exit", (), r"toy: fmi2DoStep at t = 0.051 s .*exit code 3"),
        ("crash", (), r"toy: fmi2DoStep at t = 0.051 s .*SIGSEGV"),
        ("hang", ['step_timeout = "2 s"'], r"toy: fmi2DoStep at t = 0.051 s .*within 2 s"),
    ],
)
def test_a_case_says_when_its_fmu_ended_and_the_process_of_the_cases_stays(isolate, mode, more, error):
    isolated, pids, rows = isolate(*more), [], []
    for row in isolated.run(enumerate([GAIN, {**GAIN, "toy.mode": mode}, GAIN])):
        rows.append(row)
        pids.append(isolated.pid)
    assert [row["status"] for row in rows] == [DONE, FAILED, DONE]
    assert pids == pids[:1] * 3
    assert re.search(error, rows[1]["error"])


def test_the_memory_of_the_fmus_counts(isolate):
    # The time-out cannot come first: on a busy machine an FMU takes seconds to fill 1 GB.
    rows = list(isolate('step_timeout = "1000 s"').run(enumerate([GAIN, {**GAIN, "toy.mode": "eat"}, GAIN])))
    assert [row["status"] for row in rows] == [DONE, KILLED, DONE]
    assert "1000000000 bytes of memory" in rows[1]["error"]


def test_the_choice_travels_with_the_study(unpack):
    isolation = CaseRunner(unpack('isolate = ["toy"]', 'step_timeout = "5 s"')).task.isolation
    assert (isolation.names, isolation.step_timeout_s) == ({"toy"}, 5.0)
    assert CaseRunner(unpack()).task.isolation is None
