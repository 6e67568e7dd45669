"""Rows of cases: the numbers are those of the signals, and whatever a case does, its neighbours are computed.

FMUs may have processes of their own: the rows are the same, and a case that breaks its FMU costs nothing more.
"""

import json
import re
import signal
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import psutil
import pytest
from support.claims import verify_claim
from support.cosim import Collect
from support.processes import PATIENCE_S, wait_until

from ps_fmu.cosim import Column, Master
from ps_fmu.pointing.indices import AbsoluteError, RelativeError
from ps_fmu.requirements.quantity import Delay, Names, Time
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.observed import IndexRecord, find_signals
from ps_fmu.studies.rows import DONE, FAILED, KILLED, LATE, StartError, VersionError
from ps_fmu.studies.study import Observed
from ps_fmu.studies.worker import CaseProcess, run_batch

GAIN = {"toy.gain": 1.5}


def test_an_output_of_this_name_is_no_vector():
    """As in requirements; a vector without its ``.x`` or ``_1`` has its components."""
    names = ["speed", "speed_2", "leg_1", "leg_2", "v.x", "v.y", "leg_1_late", "v.x.y"]
    columns = [Column(f"a.{name}", "m/s", "Real", "") for name in names]
    assert find_signals(Observed(signal=Names(["a.speed"])), columns) == {"a.speed": 0}
    assert find_signals(Observed(signal=Names(["a.leg", "a.v"])), columns) == {
        "a.leg_1": 2, "a.leg_2": 3, "a.v.x": 4, "a.v.y": 5
    }  # fmt: skip


@pytest.fixture
def folder(make_prepared, tmp_path):
    """The unpacked files of a study of the toy."""
    return make_prepared().bundle.unpack(tmp_path)


@pytest.fixture
def run_cases(folder):
    """Runs cases in a process; closes it."""
    made = []

    def run(values, **options):
        process = CaseProcess(folder, **options)
        made.append(process)
        return list(process.run(enumerate(values)))

    yield run
    for process in made:
        process.close()


def without_time(rows):
    return [{name: value for name, value in row.items() if name != "wall_s"} for row in rows]


def test_the_numbers_of_a_row_are_those_of_the_signals(make_prepared, tmp_path):
    prepared = make_prepared()
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    row = runner.run(0, {**GAIN, "toy.seed": 5})
    seen = Collect()
    with Master(prepared.system.structure.with_parameters({**GAIN, "toy.seed": 5}), 1e-3) as master:
        master.initialise()
        master.run(0.1, [seen])
        places = [[column.name for column in master.columns].index(f"toy.error.{axis}") for axis in "xy"]
        large = [column.name for column in master.columns].index("toy.large")
    record = seen.values[10:, places]  # after the settling
    off = []
    for name, index in (("APE", AbsoluteError()), ("RPE_0.02s", RelativeError(0.02, "uniform"))):
        values = index.values(record, 1e-3, stride=1 if name == "APE" else None).reshape(-1, 2)
        for place, axis in enumerate("xy"):
            rms = float(np.sqrt(np.mean(values[:, place] ** 2)))
            off.append(abs(row[f"active.toy.error.{axis}.{name}.rms"] / rms - 1.0))
            assert row[f"active.toy.error.{axis}.{name}.peak"] == np.abs(values[:, place]).max()
    assert row["active.toy.large.share"] == pytest.approx(seen.values[:, large].mean(), rel=1e-12)
    assert 0.0 < row["active.toy.large.share"] < 1.0
    verify_claim(
        "study.rows",
        claim="RMS and peak of what a study observes, share of time of flags",
        where="study.parquet, study page, table of `ps-fmu sweep`",
        reference="all rows of the same case, run alone",
        error=off,
        bound=1e-12,
    )


def test_a_mixed_requirement_is_judged_by_all_times_of_all_cases(write_study, make_prepared, tmp_path):
    """The quantile of all values, from the histograms in the rows."""
    from ps_fmu.cosim.rows import make_layout
    from ps_fmu.requirements.requirement import read_requirements
    from ps_fmu.studies.bundle import open_folder
    from ps_fmu.studies.outcome import collect, find_compliance
    from ps_fmu.studies.rows import RowStore
    from ps_fmu.studies.sweep import compare_rows

    kinds = ("mixed", "temporal", "ensemble")
    (tmp_path / "r.toml").write_text("".join(
        f'[[requirement]]\nname = "{kind}"\nsignal = "toy.error.x"\nindex = "APE"\nprobability = 0.9\n'
        f'confidence = 0.5\ninterpretation = "{kind}"\nlimit = "3 1"\n' for kind in kinds
    ))  # fmt: skip
    prepared = make_prepared(changes={'plan = "random"': 'plan = "random"\nrequirements = "r.toml"'})
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    rows = [runner.run(index, prepared.plan.values(index)) for index in range(6)]
    folder = tmp_path / "out"
    folder.mkdir()
    open_folder(folder, prepared.plan, prepared.identity, resume=False)
    store = RowStore(folder, prepared.identity.plan_sha256)
    for some in (rows[:2], rows[2:5], rows[4:]):  # a case twice
        store.add(some)
    compared = compare_rows(rows[3], next(store.read(3)))
    assert compared == "all numbers are those of the study, to the last bit"
    columns = make_layout(prepared.system.descriptions).columns
    requirements = read_requirements(tmp_path / "r.toml")
    outcome = collect(folder, prepared.plan, prepared.identity.plan_sha256, columns, requirements)
    assert not [name for name in outcome.table if name.endswith("/histogram")]
    mixed, temporal, ensemble = (one.pooled for one in find_compliance(outcome))
    exact = np.quantile(np.abs(run_values(prepared)), 0.9, method="inverted_cdf")
    assert exact <= mixed.value <= exact * 10.0 ** (1.0 / 2000.0)
    assert mixed.lower < mixed.value <= mixed.bound < mixed.upper < np.inf
    own = [row["verdict/temporal/active/toy.error.x/value"] for row in rows]
    assert temporal.value == max(own)
    assert temporal.bound == max(row["verdict/temporal/active/toy.error.x/bound"] for row in rows)
    assert temporal.ensemble_share == pytest.approx(0.5 ** (1.0 / 6.0))
    answers = [row["verdict/temporal/active/toy.error.x/answer"] for row in rows]
    expected = next(one for one in ("not met", "cannot be said", "not shown", "met") if one in answers)
    assert [one.answer for one in find_compliance(outcome)][1] == expected
    assert ensemble.value == sorted(np.abs(run_values(prepared)).max(axis=1))[5]  # the 0.9-quantile of six


def run_values(prepared):
    """error.x of all cases, (cases, rows), from the signals."""
    found = []
    for index in range(len(prepared.plan)):
        seen = Collect()
        with Master(prepared.system.structure.with_parameters(prepared.plan.values(index)), 1e-3) as master:
            master.initialise()
            master.run(0.1, [seen])
            place = [column.name for column in master.columns].index("toy.error.x")
        found.append(seen.values[:, place])
    return np.array(found)


def test_how_the_rows_are_cut_into_blocks_does_not_matter():
    columns = [type("Column", (), {"name": f"a.e.{axis}", "type": "Real", "unit": "rad"}) for axis in "xy"]
    values = np.random.default_rng(3).standard_normal((103, 2))
    observed = Observed(
        signal=Names(["a.e"]), index=Names(["APE", "RPE"]), window=Time(0.01), at="end", settling=Delay(0.005)
    )  # fmt: skip
    found = []
    for block in (1, 7, 103):
        record = IndexRecord(observed, columns, 1e-3)
        for first in range(0, 103, block):
            record.block(first, np.zeros(block), values[first : first + block])
        found.append(record.metrics())
    for other in found[1:]:
        assert other == pytest.approx(found[0], rel=1e-13)
    assert found[0]["a.e.x.APE.peak"] == np.abs(values[5:, 0]).max()


def test_a_process_gives_the_rows_that_this_process_computes(folder, run_cases):
    values = [{**GAIN, "toy.seed": seed} for seed in (1, 2)]
    runner = CaseRunner(folder)
    assert without_time(run_cases(values)) == without_time([runner.run(i, own) for i, own in enumerate(values)])


def test_a_case_that_breaks_has_a_row_and_its_neighbours_are_computed(run_cases):
    broken = {
        "raise": (FAILED, "the model broke"),
        "nan": (FAILED, "not a finite number"),
        "exit": (KILLED, "exit code 3; it printed: about to leave"),
        "end": (KILLED, "exit code "),
        "crash": (KILLED, "signal SIGSEGV"),
    }
    good, *rows = run_cases([GAIN, *(values for mode in broken for values in ({**GAIN, "toy.mode": mode}, GAIN))])
    for (status, error), row, after in zip(broken.values(), rows[::2], rows[1::2], strict=True):
        assert row["status"] == status and error in row["error"]
        assert without_time([after]) == without_time([{**good, "case": after["case"]}])


def test_a_case_that_hangs_is_ended(run_cases):
    rows = run_cases([GAIN, {**GAIN, "toy.mode": "hang"}, GAIN], timeout_s=2.0)
    assert [row["status"] for row in rows] == [DONE, LATE, DONE]


def test_a_case_that_takes_all_memory_of_a_worker_is_ended(make_prepared, tmp_path, monkeypatch):
    """What the worker itself does not need is shared by its threads, here two with 400 MB each."""
    here = SimpleNamespace(name="here", local_directory=tmp_path, state=SimpleNamespace(nthreads=2))
    monkeypatch.setattr("distributed.get_worker", lambda: here)
    prepared = make_prepared(changes={'"0.1 s"': '"0.12 s"'})  # this process has not unpacked it
    here.memory_manager = SimpleNamespace(memory_limit=psutil.Process().memory_info().rss + 800_000_000)
    rows = run_batch(prepared.bundle, list(enumerate([GAIN, {**GAIN, "toy.mode": "eat"}, GAIN])), None).rows
    assert [row["status"] for row in rows] == [DONE, KILLED, DONE]
    (left,) = map(int, re.findall(r"more than the (\d+) MB of memory that are left for it: ", rows[1]["error"]))
    assert abs(left - 400) < 20


def test_a_process_that_somebody_else_ends_does_not_cost_the_case(folder, run_cases, tmp_path):
    mark = tmp_path / "was_here"
    rows = run_cases([{**GAIN, "toy.once": str(mark)}])
    assert mark.exists()  # it has been ended once
    assert rows[0]["status"] == DONE
    assert without_time(rows) == without_time(run_cases([GAIN]))


def test_the_process_ends_with_the_one_that_started_it(folder):
    text = (
        "import os, signal, sys; from pathlib import Path; from ps_fmu.studies.worker import CaseProcess\n"
        "process = CaseProcess(Path(sys.argv[1])); next(process.run([(0, {})])); print(process.pid, flush=True)\n"
        "os.kill(os.getpid(), signal.SIGKILL)"
    )
    ended = subprocess.run([sys.executable, "-c", text, str(folder)], stdout=subprocess.PIPE, timeout=PATIENCE_S)
    assert ended.returncode == -signal.SIGKILL
    wait_until(lambda: not psutil.pid_exists(int(ended.stdout)))


def test_a_process_that_does_not_start_says_why(folder):
    (folder / "system.json").write_bytes(b"no system")
    with pytest.raises(StartError, match=r"does not start: SystemFileError: .*system.json"):
        next(CaseProcess(folder).run([(0, GAIN)]))


@pytest.mark.parametrize("source", ["../elsewhere.fmu", "/elsewhere.fmu", "fmus/../../elsewhere.fmu"])
def test_an_fmu_outside_the_files_of_a_study_is_not_loaded(folder, source):
    system = json.loads((folder / "system.json").read_text())
    system["components"][0]["source"] = source
    (folder / "system.json").write_text(json.dumps(system))
    with pytest.raises(StartError, match=f"(?s){source}.*is not a path inside the folder"):
        next(CaseProcess(folder).run([(0, GAIN)]))


def test_a_worker_with_other_packages_is_refused(folder):
    task = json.loads((folder / "task.json").read_text())
    task["versions"]["numpy"] = "1.0"
    (folder / "task.json").write_text(json.dumps(task))
    process = CaseProcess(folder)
    with pytest.raises(VersionError, match=r"numpy \S+ instead of 1.0"):
        next(process.run([(0, GAIN)]))


def test_damaged_files_are_refused(make_prepared, tmp_path):
    from dataclasses import replace

    bundle = make_prepared().bundle
    with pytest.raises(ValueError, match="damaged"):
        replace(bundle, files={**bundle.files, "task.json": b"{}"}).unpack(tmp_path)


@pytest.fixture
def unpack(make_prepared, tmp_path):
    """Makes the unpacked files of a study of the toy, with these lines more in [study]."""
    return lambda *more: make_prepared(changes={"seed = 7": "\n".join(["seed = 7", *more])}).bundle.unpack(tmp_path)


@pytest.fixture
def isolate(unpack):
    """Makes a process for the cases of a study with isolated FMUs; with these lines more in [study]."""
    made = []

    def make(*more):
        made.append(CaseProcess(unpack("isolate = true", *more), memory_bytes=500_000_000, isolates=True))
        return made[-1]

    yield make
    for process in made:
        process.close()


def test_rows_are_those_of_the_same_process(unpack, isolate):
    cases = [{**GAIN, "toy.seed": seed} for seed in (1, 2)]
    plain = CaseRunner(unpack())
    expected = [plain.run(place, own) for place, own in enumerate(cases)]
    assert without_time(isolate().run(enumerate(cases))) == without_time(expected)


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
    # The time-out cannot come first: on a busy machine an FMU takes seconds to fill memory.
    rows = list(isolate('step_timeout = "1000 s"').run(enumerate([GAIN, {**GAIN, "toy.mode": "eat"}, GAIN])))
    assert [row["status"] for row in rows] == [DONE, KILLED, DONE]
    assert "more than the 500 MB of memory" in rows[1]["error"]


def test_the_choice_travels_with_the_study(unpack):
    isolation = CaseRunner(unpack('isolate = ["toy"]', 'step_timeout = "5 s"')).task.isolation
    assert (isolation.names, isolation.step_timeout_s) == ({"toy"}, 5.0)
    assert CaseRunner(unpack()).task.isolation is None
