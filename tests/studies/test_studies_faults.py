"""Studies whose runs have faults."""

import json

import pytest

from ps_fmu.studies.bundle import explain_difference
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.study import StudyError

STUDY = {'plan = "random"': 'plan = "random"\nfaults = "faults.json"'}
EVENT = {"time": 0.02, "model": "toy", "variable": "u", "action": "override", "value": 2.0}


def write(folder, **more):
    (folder / "faults.json").write_text(json.dumps({"events": [{**EVENT, **more}]}))


def test_each_case_has_the_faults(make_prepared, tmp_path):
    write(tmp_path)
    prepared = make_prepared(changes=STUDY)
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    assert runner.run(0, {"toy.gain": 1.5})["status"] == "done"
    with runner.prepare({"toy.gain": 1.5}) as master:
        assert master.get("toy.u") == 0.0
        master.run(0.03)
        assert master.get("toy.u") == 2.0
        assert [fault.text for fault in master.faults.list_acted(master.time)] == ["0.020 s: toy.u replaced by 2"]
    runner.close()


def test_other_faults_are_another_study(make_prepared, tmp_path):
    write(tmp_path)
    first = make_prepared(changes=STUDY).identity
    write(tmp_path, value=3.0)
    other = make_prepared(changes=STUDY).identity
    plain = make_prepared().identity
    assert len({found.plan_sha256 for found in (first, other, plain)}) == 3
    assert explain_difference(first, other) == "other faults"
    assert explain_difference(plain, other) == "other faults"
    assert plain.faults_sha256 is None


def test_faults_that_no_case_can_have_are_refused(make_prepared, tmp_path):
    with pytest.raises(StudyError, match=r"study, faults: there is no file .*faults\.json"):
        make_prepared(changes=STUDY)
    write(tmp_path, time=0.1)
    with pytest.raises(ValueError, match="is not before the end of the run"):
        make_prepared(changes=STUDY)
    write(tmp_path, variable="v")
    with pytest.raises(ValueError, match=r"faults\.json: events\[0\]: the FMU ToyStudy has no variable 'v'"):
        make_prepared(changes=STUDY)
    write(tmp_path)
