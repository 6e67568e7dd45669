"""Stored runs: their bandwidth, those that ended early, ensembles of files."""

import netCDF4
import numpy as np
import pytest
from support.required import COLUMNS

from ps_fmu.cosim import Recorder
from ps_fmu.requirements.record import RequirementRecord
from ps_fmu.requirements.requirement import RequirementError, read_requirements
from ps_fmu.requirements.stored import ResultsError, judge_files
from ps_fmu.requirements.verdict import Answer

STEP = 0.01


@pytest.fixture
def store(tmp_path, white):
    """Records rows of white noise of 0.1 urad; returns the path and the rows."""

    def store(name="results.nc", case="active", duration_s=20.0, storage_step=STEP, rows=None, seed=1, append=False):
        values = 1e-7 * white(round(duration_s / STEP) + 1 if rows is None else rows, seed)
        values[:, 5] = 1.0
        about = {"step_s": STEP, "duration_s": duration_s}
        path = tmp_path / name
        with Recorder(
            path, case, columns=COLUMNS, step=STEP, storage_step=storage_step, attributes=about, append=append
        ) as recorder:
            recorder.block(0, np.arange(len(values)) * STEP, values)
        return path, values

    return store


def judge_one(path, requirements):
    (verdict,) = judge_files([path] if not isinstance(path, list) else path, requirements)
    return verdict


def test_all_rows_give_what_the_run_gave(store, require):
    path, values = store()
    requirement = require(settling="2 s")
    record = RequirementRecord(requirement, COLUMNS, STEP, len(values))
    record.block(0, np.arange(len(values)) * STEP, values)
    verdict = judge_one(path, [requirement])
    (during,) = record.distributions
    assert verdict.answer is Answer.MET
    assert verdict.statement.value == during.quantile(0.95)
    assert verdict.statement.independent == during.weigh_share(0.95).count_ranks(0.9)
    assert verdict.rows == "all rows, 0.01 s apart"


@pytest.mark.parametrize("chunk", [None, 90, 1500, 5001])
def test_verdicts_do_not_depend_on_the_chunks_of_the_file(store, require, chunk):
    """None: the signals lie in one piece, as in a file that another program has written."""
    path, _ = store(duration_s=150.0)
    with netCDF4.Dataset(path) as old, netCDF4.Dataset(path.with_name("other.nc"), "w") as new:
        group, copy = old["active"], new.createGroup("active")
        copy.setncatts({name: group.getncattr(name) for name in group.ncattrs()})
        copy.createDimension("time", len(group["time"]))
        layout = {"contiguous": True} if chunk is None else {"chunksizes": (chunk,)}
        for name, variable in group.variables.items():
            made = copy.createVariable(name, variable.dtype, ("time",), **layout)
            made.setncatts({key: variable.getncattr(key) for key in variable.ncattrs()})
            made[:] = variable[:]
    assert judge_one(path.with_name("other.nc"), [require()]) == judge_one(path, [require()])


def test_thinned_rows_say_which_bandwidth_they_have(store, require):
    """Ten times fewer rows of white noise, filtered to 4 of 50 Hz: a tenth of the variance is left."""
    path, _ = store(storage_step=0.1, duration_s=200.0)
    verdict = judge_one(path, [require(index="APE", at=None, window=None)])
    assert verdict.rows == "rows 0.1 s apart, filtered to 4 Hz"
    assert verdict.statement.value == pytest.approx(1.96e-7 * np.sqrt(0.09), rel=0.1)


def test_a_window_that_is_no_whole_number_of_rows(store, require):
    path, _ = store(storage_step=0.1)
    with pytest.raises(RequirementError, match=r"blur\), window: 0\.15 s is not a whole number .* between stored rows"):
        judge_files([path], [require(window="150 ms")])


def test_an_interrupted_run_is_judged_as_far_as_it_came(store, require):
    path, _ = store(rows=501)
    verdict = judge_one(path, [require()])
    assert verdict.statement is not None
    assert verdict.rows == "all rows, 0.01 s apart; the run was interrupted at 5 of 20 s"
    assert verdict.answer is Answer.MET
    too_short = judge_one(path, [require(window="10 s")])
    remark = "a run ends before one window of RPE is full: run longer."
    assert (too_short.answer, too_short.remark) == (Answer.OPEN, remark)


def test_a_file_that_is_still_open_for_writing(store, require, tmp_path, white):
    """As a run leaves it that was killed: what was flushed is there."""
    recorder = Recorder(tmp_path / "killed.nc", "active", columns=COLUMNS, step=STEP, attributes={"duration_s": 100.0})
    recorder.block(0, np.arange(8000) * STEP, 1e-7 * white(8000))
    copy = tmp_path / "copy.nc"
    copy.write_bytes((tmp_path / "killed.nc").read_bytes())
    recorder.close()
    assert "interrupted at 79.99 of 100 s" in judge_one(copy, [require()]).rows


def test_a_run_that_is_not_in_the_file(store, require):
    path, _ = store(case="passive")
    verdict = judge_one(path, [require()])
    assert (verdict.answer, verdict.case) == (Answer.OPEN, "active")
    assert verdict.remark == "there is no run active; there are: passive"
    path, _ = store(case="passive", rows=501)
    remark = judge_one(path, [require()]).remark
    assert remark == "there is no run active; there are: passive (the run was interrupted at 5 of 20 s)"


def test_each_run_that_a_pattern_names(store, require):
    path, _ = store(case="roll_active")
    store(case="pitch_active", append=True, seed=2)
    store(case="pitch_passive", append=True, seed=3)
    verdicts = judge_files([path], [require(case="*_active")])
    assert [verdict.case for verdict in verdicts] == ["roll_active", "pitch_active"]


def test_files_are_members_of_an_ensemble(store, require):
    paths = [store(f"{seed}.nc", seed=seed)[0] for seed in range(45)]
    requirement = require(interpretation="ensemble")
    verdict = judge_one(paths, [requirement])
    assert verdict.answer is not Answer.OPEN
    assert verdict.statement.independent == 45
    assert verdict.rows == "all rows, 0.01 s apart"
    assert judge_one(paths[:44], [requirement]).answer is Answer.NOT_SHOWN
    assert judge_one(paths[:4], [requirement]).answer is Answer.OPEN


def test_the_same_run_twice_is_no_ensemble(store, require):
    (first, _), (second, _) = store("a.nc"), store("b.nc")
    with pytest.raises(ResultsError, match=r"a\.nc and .*b\.nc are the same run"):
        judge_files([first, second], [require()])


def test_files_without_one_of_the_runs(store, require):
    (first, _), (second, _) = store("a.nc"), store("b.nc", case="passive")
    verdict = judge_one([first, second], [require()])
    assert verdict.rows == f"all rows, 0.01 s apart; no run active in {second}"


@pytest.mark.parametrize(
    ("signal", "problem"),
    [
        ("plant.rotation.w", "there is no output 'plant.rotation.w'; did you mean plant.rotation."),
        ("commander.reachable", "of the type Boolean"),
        ("time", "there is no output 'time'"),
    ],
)
def test_signals_that_the_file_has_not(store, write, signal, problem):
    path, _ = store()
    with pytest.raises(RequirementError) as refused:
        judge_files([path], read_requirements(write({"signal": signal})))
    assert problem in str(refused.value)


def test_files_that_are_no_results(tmp_path, require):
    (tmp_path / "text.nc").write_text("no results")
    netCDF4.Dataset(tmp_path / "empty.nc", "w").close()
    with netCDF4.Dataset(tmp_path / "short.nc", "w") as file:
        group = file.createGroup("active")
        group.createDimension("time", None)
        group.createVariable("time", "f8", ("time",))[:] = [0.0]
        group.createVariable("plant.rotation.x", "f8", ("time",)).units = "rad"
    for name, problem in (
        ("none.nc", "No such file"), ("text.nc", "cannot be read"), ("empty.nc", "holds no run"),
        ("short.nc", "there are 1 rows; two are needed"),
    ):  # fmt: skip
        with pytest.raises(ResultsError, match=rf"{name}: .*{problem}"):
            judge_files([tmp_path / name], [require()])


def test_values_that_are_not_finite(store, require):
    path, _ = store()
    with netCDF4.Dataset(path, "a") as file:
        file["active"]["plant.rotation.x"][7] = np.nan
    with pytest.raises(ResultsError, match="the run active has values that are not finite"):
        judge_files([path], [require()])


def test_groups_of_other_programs(store, require):
    """Groups without times are no runs; attributes that are no numbers are passed over."""
    path, _ = store()
    with netCDF4.Dataset(path, "a") as file:
        file.createGroup("notes").about = "no run"
        file["active"].duration_s = "long"
        file["active"].step_s = [1.0, 2.0]
        file["active"].createDimension("place", 3)
        file["active"].createVariable("plant.rotation.z", "f8", ("place",)).units = "rad"
    verdict = judge_one(path, [require(case=["active", "notes"])])
    assert verdict.rows == "all rows, 0.01 s apart"
    with pytest.raises(RequirementError, match=r"there is no output 'plant\.rotation\.z'"):
        judge_files([path], [require(signal="plant.rotation.z")])


def test_a_text_beside_the_signals_is_no_signal(store, require):
    """As other programs leave it in a group; so is a unit that is no text."""
    path, _ = store()
    with netCDF4.Dataset(path, "a") as file:
        file["active"].createVariable("plant.note", str, ("time",))[0] = "begun"
        file["active"].createVariable("plant.odd", "f8", ("time",)).units = 5
    assert judge_one(path, [require()]).answer is Answer.MET
    with pytest.raises(RequirementError, match=r"signal: plant\.note is of the type String: expected a Real"):
        judge_files([path], [require(signal="plant.note")])
    with pytest.raises(RequirementError, match=r"limit: plant\.odd: nothing can be converted to the unit '5'"):
        judge_files([path], [require(signal="plant.odd")])


def test_a_file_that_was_cut_off_or_damaged_says_so(tmp_path, store, require):
    path, _ = store()
    whole = path.read_bytes()
    cut = tmp_path / "cut.nc"
    cut.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(ResultsError, match=r"cut\.nc: cannot be read: .*it is damaged or was cut off"):
        judge_files([cut], [require()])
    (tmp_path / "empty.nc").write_bytes(b"")
    with pytest.raises(ResultsError, match=r"empty\.nc: cannot be read: .*it is no netCDF file"):
        judge_files([tmp_path / "empty.nc"], [require()])
    with pytest.raises(ResultsError, match=r"it is a folder; its results\.nc is meant"):
        judge_files([tmp_path], [require()])


def test_rows_that_cannot_be_unpacked(tmp_path, require):
    """Damage among the values of a file that opens: a checksum that does not agree."""
    path = tmp_path / "results.nc"
    values = np.random.default_rng(1).normal(0.0, 1e-7, 2001)
    with netCDF4.Dataset(path, "w") as file:
        group = file.createGroup("active")
        group.createDimension("time", None)
        group.createVariable("time", "f8", ("time",))[:] = STEP * np.arange(2001)
        signal = group.createVariable("plant.rotation.x", "f8", ("time",), fletcher32=True)
        signal.units, signal[:] = "rad", values
    content = bytearray(path.read_bytes())
    content[content.index(values[1000].tobytes())] ^= 0xFF
    path.write_bytes(content)
    with pytest.raises(ResultsError, match=r"results\.nc: the run active is damaged, rows from 0 s on cannot be read"):
        judge_files([path], [require()])


def test_rows_that_are_not_equally_spaced(store, require):
    """As of another program that stored each row at first and then each tenth: windows would be of mixed lengths."""
    path, _ = store()
    with netCDF4.Dataset(path, "a") as file:
        file["active"]["time"][:] = STEP * np.concatenate((np.arange(1000), 1000.0 + 10.0 * np.arange(1001)))
    with pytest.raises(ResultsError, match=r"the run active: the rows are not equally spaced, as at .* one each"):
        judge_files([path], [require()])


def test_times_that_do_not_ascend(store, require):
    path, _ = store()
    with netCDF4.Dataset(path, "a") as file:
        file["active"]["time"][:] = np.zeros(2001)
    with pytest.raises(ResultsError, match="the run active: the times do not ascend"):
        judge_files([path], [require()])
