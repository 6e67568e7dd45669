"""Studies whose runs begin in the state of a checkpoint."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from support.checkpoints import Keep

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.checkpoint.checkpoints import Checkpoints
from ps_fmu.studies.bundle import open_folder
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.rows import DONE, RowStore
from ps_fmu.studies.study import StudyError
from ps_fmu.studies.sweep import SweepOptions, prepare, rerun
from ps_fmu.studies.worker import run_batch

H = 0.01
SETTLING = 30
"""Steps of the run that leaves the checkpoint."""
STUDY = """
[study]
system = "toys.ssd"
duration = "0.2 s"
step = "10 ms"
plan = "list"
seed = 1

[from]
checkpoint = "settled"

[[vary]]
parameter = "mass.mass"
values = [2.0, 7.0, 3.0]

[[observe]]
signal = "mass.position"
"""
TWO_RUNS = '[runs.a]\n"first.increment" = 1\n[runs.b]\n"first.increment" = 4\n[[vary]]'


@pytest.fixture
def settle(stateful, tmp_path):
    """Runs the system and leaves a checkpoint in a folder; its path."""

    def run(place="settled", steps=SETTLING, events=(), only=None, **values):
        system = read_system(stateful / "toys.ssd", stateful).with_parameters(values)
        with Master(system, H, only=only) as master:
            master.initialise()
            master.run(steps * H, [Keep()], events, checkpoints=Checkpoints(tmp_path / place, 10.0))
        return tmp_path / place

    return run


@pytest.fixture
def plan(stateful, tmp_path):
    """Prepares the study, with texts of it replaced."""

    def make(changes=None, output="out"):
        text = STUDY
        for old, new in (changes or {}).items():
            assert old in text
            text = text.replace(old, new)
        shutil.copy(stateful / "toys.ssd", tmp_path)
        (tmp_path / "study.toml").write_text(text)
        options = SweepOptions(tmp_path / "study.toml", tmp_path / output, fmus=stateful, progress=False)
        return prepare(options), options

    return make


def run_whole(stateful, events, steps=SETTLING + 20):
    """Position of the mass in each row of a run from the start on."""
    keep = Keep()
    with Master(read_system(stateful / "toys.ssd", stateful), H) as master:
        place = [column.name for column in master.columns].index("mass.position")
        master.initialise()
        master.run(steps * H, [keep], events)
    return keep.values[:, place]


@pytest.mark.parametrize("only", [None, ["first.count"]], ids=["all", "one column"])
def test_a_case_is_one_run_with_an_event_at_the_checkpoint(settle, plan, stateful, tmp_path, only):
    """Whatever the run of the checkpoint recorded, and although its file is gone when the cases run."""
    kept = settle(only=only, events=[(0.1, "mass.mass", 5.0)])
    prepared, _ = plan()
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    shutil.rmtree(kept)
    # A case says 2.0, with which the other run began, too: its mass is not the 5.0 of there.
    for case, mass in enumerate((2.0, 7.0, 3.0)):
        row = runner.run(case, prepared.plan.values(case))
        expected = run_whole(stateful, [(0.1, "mass.mass", 5.0), (0.3, "mass.mass", mass)])[SETTLING:]
        assert row["status"] == DONE, row["error"]
        assert row["active.mass.position.APE.peak"] == np.abs(expected).max()
        assert row["active.mass.position.APE.rms"] == pytest.approx(np.sqrt(np.mean(expected**2)), rel=1e-13)


def test_a_case_again_has_the_same_bits(settle, plan, tmp_path):
    settle()
    prepared, options = plan({"[[vary]]": TWO_RUNS})
    runner = CaseRunner(prepared.bundle.unpack(tmp_path))
    options.output.mkdir()
    open_folder(options.output, prepared.plan, prepared.identity, resume=False)
    rows = [runner.run(case, prepared.plan.values(case)) for case in (2, 0, 1, 2)]
    assert {**rows[0], "wall_s": 0.0} == {**rows[3], "wall_s": 0.0}
    assert rows[0]["b.first.odd.share"] < rows[0]["a.first.odd.share"]
    RowStore(options.output, prepared.identity.plan_sha256).add(rows[1:])
    assert "all numbers are those of the study, to the last bit" in rerun(options, 2)


def test_the_checkpoint_travels_to_workers_and_is_read_once(settle, plan, tmp_path):
    settle()
    prepared, _ = plan()
    done = run_batch(prepared.bundle, [(case, prepared.plan.values(case)) for case in range(2)], None)
    assert [row["status"] for row in done.rows] == [DONE, DONE]
    folder = prepared.bundle.unpack(tmp_path)
    runner = CaseRunner(folder)
    files = list(folder.glob("checkpoint*"))
    assert len(files) == 1  # one for the runs that begin from the same file
    files[0].unlink()
    assert runner.run(0, prepared.plan.values(0))["status"] == DONE


def test_isolated_fmus_begin_there_with_the_same_rows(settle, plan, tmp_path):
    settle()
    rows = []
    for more in ("", "isolate = true\n"):
        prepared, _ = plan({"seed = 1\n": f"seed = 1\n{more}"})
        runner = CaseRunner(prepared.bundle.unpack(tmp_path))
        rows.append({**runner.run(1, prepared.plan.values(1)), "wall_s": 0.0})
        runner.close()
    assert rows[0] == rows[1]
    assert rows[0]["status"] == DONE


def test_each_run_begins_from_the_case_of_its_name(settle, plan, stateful, tmp_path):
    settle("settled/checkpoint/a")
    settle("settled/checkpoint/b", events=[(0.2, "mass.force", 3.0)])
    prepared, _ = plan({"[[vary]]": TWO_RUNS})
    row = CaseRunner(prepared.bundle.unpack(tmp_path)).run(0, {})
    pushed = run_whole(stateful, [(0.2, "mass.force", 3.0)])
    assert row["b.mass.position.APE.peak"] == np.abs(pushed[SETTLING:]).max() != row["a.mass.position.APE.peak"]
    assert [*prepared.identity.checkpoints_sha256] == ["a", "b"]
    with pytest.raises(StudyError, match=r"from, checkpoint: .* it has a, b: give the folder of one"):
        plan()
    settle("settled/checkpoint/b", steps=10)
    with pytest.raises(StudyError, match=r"run 'b' is of t = 0.1 s, that of 'a' of 0.3 s"):
        plan({"[[vary]]": TWO_RUNS})


def test_another_checkpoint_behind_the_same_name_is_not_resumed(settle, plan):
    settle()
    prepared, options = plan()
    options.output.mkdir()
    open_folder(options.output, prepared.plan, prepared.identity, resume=False)
    before = (options.output / "manifest.json").read_bytes()
    open_folder(options.output, prepared.plan, plan()[0].identity, resume=True)
    settle(events=[(0.1, "mass.mass", 5.0)])
    with pytest.raises(StudyError, match=r"another checkpoint for the run active: \w{12}, there \w{12}.  Nothing was"):
        open_folder(options.output, prepared.plan, plan()[0].identity, resume=True)
    with pytest.raises(StudyError, match=r"has another study .*: no checkpoint to begin from"):
        cold = plan({'[from]\ncheckpoint = "settled"': ""})[0].identity
        open_folder(options.output, prepared.plan, cold, resume=True)
    anew = plan({'"settled"': '"settled"\nanew = ["first"]'})[0].identity
    assert anew.plan_sha256 != prepared.identity.plan_sha256
    assert (options.output / "manifest.json").read_bytes() == before


LABEL = {'parameter = "mass.mass"\nvalues = [2.0, 7.0, 3.0]': 'parameter = "label"\nvalues = ["x", "y"]'}


def test_what_is_in_the_state_is_refused_by_name_when_the_study_is_planned(settle, plan, tmp_path):
    settle()
    with pytest.raises(StudyError, match=(
        r"study\.toml, vary\[0\] \(label\), parameter: first\.label is a fixed parameter: it is in the state .*"
        r"\[from\], anew = \['first'\]"
    )):  # fmt: skip
        plan(LABEL)
    anew = {'"settled"': '"settled"\nanew = ["first"]'}
    prepared, _ = plan({**LABEL, **anew})
    assert CaseRunner(prepared.bundle.unpack(tmp_path)).run(1, prepared.plan.values(1))["status"] == DONE
    label = {"[[vary]]": '[runs.active]\n"first.label" = "x"\n[[vary]]'}
    with pytest.raises(StudyError, match=(
        r"(?s)from, checkpoint: run 'active': .*first\.label is a fixed parameter.*its value is none in "
        r"the checkpoint and x in this.*"
        r"the key anew of \[from\] for first"
    )):  # fmt: skip
        plan(label)
    assert plan({**label, **anew})


@pytest.mark.parametrize(
    ("changes", "error"),
    [
        ({'"settled"': '"nowhere"'}, r"from, checkpoint: there is no .*nowhere, and no "),
        ({'checkpoint = "settled"': ""}, r"from\.checkpoint: is missing"),
        ({'"settled"': '"settled"\nafter = 1'}, r"from\.after: unknown key"),
        ({'"settled"': '"settled"\nanew = ["frist"]'}, r"from, anew: run 'active': there is no component 'frist'"),
        ({'"10 ms"': '"5 ms"'}, r"from, checkpoint: .*belongs to another system: the step \(s\) is"),
        ({'"settled"': '"study.toml"'}, r"from, checkpoint: .*study\.toml: is not a checkpoint, or is damaged"),
        ({'[from]\ncheckpoint = "settled"': "", "\n[study]": 'from = 1\n[study]'}, r"from: expected an object"),
    ],
)  # fmt: skip
def test_what_no_case_can_begin_from_is_refused(settle, plan, changes, error):
    settle()
    with pytest.raises(StudyError, match=error):
        plan(changes)


def test_a_checkpoint_is_sought_beside_the_study_and_then_here(settle, plan, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path / "..")
    settle("elsewhere")
    here = os.path.relpath(tmp_path / "elsewhere")
    assert plan({'"settled"': f'"{here}"'})[0].identity.checkpoints_sha256.keys() == {"active"}


def test_random_numbers_go_on_unless_the_source_begins_anew(built_fmus, tmp_path):
    """On the system of ps_fmu, with another seed than a study without [from] would give it."""
    from ps_fmu.product.files import find_file

    system = read_system(find_file(Path("system/SystemStructure.ssd")), built_fmus)
    system = system.with_parameters({"disturbance.seed": 5, "disturbance.noise.band.max": 400.0})
    with Master(system, 1e-3) as master:
        master.initialise()
        master.run(0.1, [Keep()], checkpoints=Checkpoints(tmp_path / "settled", 10.0))
    study = tmp_path / "study.toml"
    text = (
        '[study]\nduration = "0.05 s"\nstep = "1 ms"\nplan = "list"\nseed = 1\n[from]\ncheckpoint = "settled"\n'
        '[[vary]]\nparameter = "commander.target.roll"\nvalues = ["0 deg", "1 deg"]\n'
    )
    options = SweepOptions(study, tmp_path / "out", fmus=built_fmus)
    peak = "active.plant.payload_rotation.x.APE.peak"
    found = []
    for anew in ("", 'anew = ["disturbance"]\n'):
        study.write_text(text.replace('"settled"\n', f'"settled"\n{anew}'))
        prepared = prepare(options)
        warned = [text for text in prepared.system.warnings.texts if "disturbance.seed is in the state" in text]
        assert bool(warned) == (not anew)
        assert prepared.plan.seed_names == (("disturbance.seed",) if anew else ())
        assert ("disturbance.seed" in prepared.plan.shared_seeds) == (not anew)  # the state has it
        row = CaseRunner(prepared.bundle.unpack(tmp_path)).run(0, prepared.plan.values(0))
        assert row["status"] == DONE, row["error"]
        found.append(row[peak])
    keep = Keep()
    with Master(system, 1e-3) as master:
        place = [column.name for column in master.columns].index("plant.payload_rotation.x")
        master.initialise()
        master.run(0.15, [keep])
    assert found[0] == np.abs(keep.values[100:, place]).max() != found[1]


def test_the_example_begins_settled_and_its_faults_vary(tmp_path, monkeypatch):
    """As the comment of the file says, with a shorter settling."""
    from ps_fmu.product.files import find_file
    from ps_fmu.simulation import simulate

    monkeypatch.chdir(tmp_path)
    simulate("isolation", system="InertialSensors.ssd", duration=0.2, checkpoint=0.2, output="results/settled",
             progress=False)  # fmt: skip
    prepared = prepare(SweepOptions(find_file(Path("system/studies/accelerometer_fails.toml")), tmp_path / "out"))
    assert len(prepared.plan) == 100
    assert prepared.plan.seed_names == ("disturbance.seed",)
    kinds = ("time", "duration", "value")
    assert prepared.plan.targets == tuple(f"faults.failure.{kind}" for kind in kinds)
    longest = int(prepared.plan.draws[:, 1].argmax())
    row = CaseRunner(prepared.bundle.unpack(tmp_path)).run(longest, prepared.plan.values(longest))
    assert row["status"] == DONE, row["error"]
    assert row["active.plant.payload_rotation.x.APE.peak"] > 1e-5  # rad; the noise alone leaves less
