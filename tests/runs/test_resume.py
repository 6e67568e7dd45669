"""Runs that are killed and gone on with: their results are those of a run that nobody disturbed, to the last bit.

``make soak`` disturbs each scenario thirty times, instead of once.
"""

import json
import os
import random
import shutil
import signal
import subprocess
import sys
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from conftest import HEAD
from support.claims import verify_claim
from support.same_results import list_differences

import ps_fmu
from ps_fmu.cli import main
from ps_fmu.cosim import Recorder
from ps_fmu.cosim.checkpoint.files import CheckpointFolder
from ps_fmu.runs import keeping

ROOT = Path(__file__).parents[2]
DRIVER = ROOT / "tests" / "support" / "killed.py"
KILLS = 30 if os.environ.get("PS_FMU_SOAK") else 1
RUNS = {
    # Two cases of 6001 rows: blocks of 2000, a checkpoint each 700.
    "isolation": (12_002, ["isolation", "--duration", "0.6", "--requirements", "own.toml"]),
    "slew": (5_602, ["slew", "--duration", "1.4", "--step", "5e-4", "--parameters", "noise.ssv"]),
}
NAMES = 40
"""About as often do files get a name in such a run."""
REQUIREMENTS = """
[[requirement]]
name = "blur"
signal = "plant.payload_rotation"
index = "RPE"
at = "uniform"
window = "50 ms"
probability = 0.5
confidence = 0.5
interpretation = "temporal"
limit = "1 mrad"

[[requirement]]
name = "jitter"
signal = "plant.los"
combine = "norm"
settling = "0.1 s"
index = "jitter"
window = "20 ms"
statistic = "rms"
confidence = 0.5
limit = "1 mm"
"""


FAULTS = {
    "defaults": {"model": "plant"},
    "events": [
        {"time": 0.03, "variable": "base_acceleration.x", "action": "delay", "value": 0.05},
        {"time": 0.03, "variable": "base_acceleration.y", "action": "dropout", "probability": 0.5},
        {"time": 0.03, "variable": "base_acceleration.z", "action": "freeze", "duration": 0.2},
        {"time": 0.1, "variable": "base_angular_acceleration.x", "action": "noise", "rms": 1e-6},
    ],
}


def start(folder, *words, driver=()):
    program = [sys.executable, "-I", *(driver or ("-m", "ps_fmu.cli")), "run", *words]
    return subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=300, check=False)


def tables(printed):
    """What a run prints, but for its last line, which has the real-time factor."""
    return printed.splitlines()[:-1]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory, built_fmus):
    """A folder with the files that the runs use, and the results of those that nobody disturbs."""
    folder = tmp_path_factory.mktemp("undisturbed")
    (folder / "own.toml").write_text(REQUIREMENTS)
    noise = '<ssv:Parameter name="disturbance.noise.enabled"><ssv:Boolean value="true"/></ssv:Parameter>'
    (folder / "noise.ssv").write_text(f"{HEAD}<ssv:Parameters>{noise}</ssv:Parameters></ssv:ParameterSet>")
    return folder


@pytest.fixture(scope="module")
def undisturbed(inputs):
    done = {}

    def run(scenario):
        if scenario not in done:
            done[scenario] = start(inputs, *RUNS[scenario][1], "--no-figures", "--output", scenario)
            assert "results in" in done[scenario].stdout, done[scenario].stderr
        return inputs / scenario, done[scenario]

    return run


@pytest.mark.parametrize("kill", range(KILLS))
@pytest.mark.parametrize("scenario", RUNS)
def test_a_killed_run_ends_with_the_results_of_an_undisturbed_one(inputs, undisturbed, tmp_path, scenario, kill):
    rows, words = RUNS[scenario]
    folder, expected = undisturbed(scenario)
    rng = random.Random(f"{scenario} {kill}")
    interval = "0.07" if scenario == "isolation" else "0.2"
    words = [*words, "--no-figures", "--checkpoint", interval, "--output", str(tmp_path / "out")]
    kind = ("rows", "names")[kill % 2]
    number = rng.randrange(rows if kind == "rows" else NAMES)
    done = start(inputs, *words, driver=(str(DRIVER), kind, str(number)))
    while done.returncode == -signal.SIGKILL:
        again = ("rows", str(rng.randrange(4 * rows)))  # perhaps it is killed again
        begun = (tmp_path / "out" / "checkpoint" / "run.json").is_file()  # else it was killed before it began
        more = ["--resume", str(tmp_path / "out"), "--no-figures"] if begun else words
        done = start(inputs, *more, driver=(str(DRIVER), *again))
    assert done.returncode == expected.returncode, done.stderr
    assert tables(done.stdout) == tables(expected.stdout)
    verify_claim(
        "master.resume",
        claim="A killed run that goes on ends with the same results, to the last bit",
        where="`ps-fmu run --resume`: results.nc, summary.json, report, terminal",
        reference="the undisturbed run",
        error=len(list_differences(folder, tmp_path / "out")),
        bound=0,
        unit="files that differ",
    )


# ---- what a user sees ----------------------------------------------------------------------------------------------


@pytest.fixture
def stopped(inputs, tmp_path):
    """The output folder of a run that was killed in its second case."""
    words = [*RUNS["isolation"][1], "--no-figures", "--checkpoint", "0.1", "--output", str(tmp_path / "out")]
    assert start(inputs, *words, driver=(str(DRIVER), "rows", "8000")).returncode == -signal.SIGKILL
    return tmp_path / "out"


@pytest.fixture
def run(capsys):
    """Run ``ps-fmu run`` in this process: exit code and what it says on the error stream."""
    def call(*words):
        try:
            code = main(["run", *map(str, words)])
        except SystemExit as end:
            code = end.code
        return code, capsys.readouterr().err

    return call


def test_what_does_not_go_on_says_why_and_loses_nothing(stopped, run, tmp_path):
    code, said = run("--resume", stopped, "--step", "2e-4")
    assert code == 2
    assert "--resume: a resumed run keeps its options, and --step is refused" in said
    code, said = run("--resume", tmp_path / "other")
    assert code == 2
    assert "there is no run with checkpoints in" in said
    assert not (tmp_path / "other").exists()
    kept = stopped / "checkpoint" / "run.json"
    text = kept.read_text()
    for old, new, words in (
        ('"package": "', '"package": "0', "is of ps_fmu 0"),
        ('"seed": 1', '"seed": "1"', "is damaged"),
        ('"duration_s": 0.6', '"duration_s": "long"', "is damaged: duration_s: Expected `float`"),
        ('"scenario": "isolation"', '"scenario": "nothing"', "ps_fmu has no scenario 'nothing'"),
        ('"seed": 1,', "", "is damaged: seed"),
        ("own.toml", "other.toml", "has changed since the run began"),
        ("{", "[", "cannot be read"),
    ):
        assert old in text
        kept.write_text(text.replace(old, new))
        code, said = run("--resume", stopped)
        assert code == 2, said
        assert words in said
    kept.write_text(text.replace('"step_s": 0.0001', '"step_s": 0.0002'))
    results = (stopped / "results.nc").read_bytes()
    code, said = run("--resume", stopped, "--no-figures")
    assert code == 1
    assert "the step (s) is 0.0001 in the checkpoint and 0.0002 in this run" in said
    assert (stopped / "results.nc").read_bytes() == results
    kept.write_text(text)
    code, said = run("--resume", stopped, "--no-figures")
    assert code == 0, said
    code, said = run("--resume", stopped)
    assert code == 2
    assert "is complete, and there is nothing to resume" in said
    assert sorted(path.name for path in (stopped / "checkpoint").rglob("*") if path.is_file()) == [
        "row-000000006000.msgpack", "row-000000006000.msgpack", "run.json",
    ]  # fmt: skip


def test_a_run_begins_where_another_one_is(run, tmp_path, ssv):
    settled = tmp_path / "settled"
    code, said = run("isolation", "--duration", "0.3", "--no-figures", "--checkpoint", "9", "--output", settled)
    assert code == 0, said
    words = ["isolation", "--duration", "0.2", "--no-figures", "--output", tmp_path / "branch"]
    code, said = run(*words, "--from", settled)
    assert code == 0, said
    branch = tmp_path / "branch" / "results.nc"
    with netCDF4.Dataset(branch) as file, netCDF4.Dataset(settled / "results.nc") as old:
        assert file["active"].warm_start_s == pytest.approx(0.3)
        np.testing.assert_allclose(file["active"]["time"][[0, -1]], [0.3, 0.5], rtol=1e-12)
        last, first = (each["active"]["plant.base_rotation.x"][place] for each, place in ((old, -1), (file, 0)))
        assert first == pytest.approx(last, rel=0.05)  # filtered over other rows
        assert abs(first) > 0.0
    slower = ssv({"isolator.delay": 0.002})
    code, said = run(*words, "--from", settled, "--parameters", slower)
    assert code == 1
    assert "isolator.delay is a fixed parameter" in said
    assert "--anew isolator" in said
    assert (tmp_path / "branch" / "report.html").is_file()  # of the run before
    nobody = ["--from", settled, "--anew", "nobody", "--output", tmp_path / "nobody"]
    code, said = run(*words, *nobody)
    assert code == 1
    assert "anew: there is no component 'nobody'" in said and "nothing was stored" in said
    assert not (tmp_path / "nobody" / "results.nc").exists()
    code, said = run(*words, "--from", settled, "--parameters", slower, "--anew", "isolator")
    assert code == 0, said
    for more, why in (
        (["--from", settled / "nothing"], "--from: there is no"),
        (["--anew", "isolator"], "--anew: only a run that begins --from a checkpoint takes it"),
        (["--from", tmp_path / "branch" / "results.nc"], "is in the output folder"),
        (["--checkpoint", "0"], "--checkpoint: expected a time above 0 s"),
    ):
        code, said = run(*words, *more)
        assert code == 2
        assert why in said
    slew = ["slew", "--step", "1e-3", "--duration", "1.2", "--no-figures", "--output", tmp_path / "slew"]
    code, said = run(*slew, "--from", settled)
    assert code == 2
    assert "has no checkpoint of isolator_off; it has active, passive" in said


def test_commands_take_checkpoints_that_are_paid_for(run, tmp_path, monkeypatch):
    """The first one of a case, and the one at its end, do not wait."""
    original, written = CheckpointFolder.write, []

    def write(self, index, tree):
        written.append((self.path.name, index))
        return original(self, index, tree)

    assert keeping.SHARE == 0.02
    monkeypatch.setattr(keeping, "SHARE", 1e-9)
    monkeypatch.setattr(CheckpointFolder, "write", write)
    words = ["isolation", "--duration", "0.3", "--no-figures", "--checkpoint", "0.05", "--output", tmp_path / "out"]
    code, said = run(*words)
    assert code == 0, said
    assert written == [("passive", 500), ("passive", 3000), ("active", 500), ("active", 3000)]


def test_a_damaged_checkpoint_says_what_helps(inputs, undisturbed, stopped, run):
    """Of a case that was done; the other one was in the middle."""
    folder = stopped / "checkpoint" / "passive"
    (journal,) = folder.glob("rows-*.bin")
    whole = {path: path.read_bytes() for path in (journal, *folder.glob("row-*.msgpack"))}
    assert len(whole) == 3
    torn = bytearray(whole[journal])
    torn[len(torn) // 2] ^= 1
    zips = {path: b"torn" for path in whole if path != journal}
    for damage, words in (({journal: torn}, "is damaged"), ({journal: None}, "No such file"), (zips, "or is damaged")):
        for path, content in {**whole, **damage}.items():
            path.unlink(missing_ok=True) if content is None else path.write_bytes(content)
        code, said = run("--resume", stopped, "--no-figures")
        assert code == 1
        assert words in said
        assert f"remove {folder}, then ps-fmu run --resume {stopped}" in said
        assert "from the last checkpoint" not in said
    shutil.rmtree(folder)
    code, said = run("--resume", stopped, "--no-figures")
    assert code == 0, said
    assert list_differences(undisturbed("isolation")[0], stopped) == []


def test_any_system_goes_on(inputs, run, tmp_path, capsys):
    assert main(["ssp", "--output", str(tmp_path / "own.ssp")]) == 0
    words = [str(tmp_path / "own.ssp"), "--step", "1e-4", "--duration", "0.4", "--observe", "plant.*", "--no-figures"]
    assert run(*words, "--output", tmp_path / "whole")[0] == 0
    again = [*words, "--checkpoint", "0.05", "--output", str(tmp_path / "out")]
    done = start(inputs, *again, driver=(str(DRIVER), "names", "8"))
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert [path.name for path in sorted((tmp_path / "out" / "checkpoint" / "run").glob("row-*"))] == [
        "row-000000002000.msgpack", "row-000000002500.msgpack",
    ]  # fmt: skip
    code, said = run("--resume", tmp_path / "out")
    assert code == 0, said
    assert list_differences(tmp_path / "whole", tmp_path / "out") == []


def test_a_system_in_a_folder_has_checkpoints_and_begins_there(run, tmp_path):
    assert main(["ssp", "--output", str(tmp_path / "own.ssp")]) == 0
    shutil.unpack_archive(tmp_path / "own.ssp", tmp_path / "own", "zip")
    words = [tmp_path / "own", "--step", "1e-3", "--duration", "0.02", "--observe", "plant.los*", "--no-figures"]
    code, said = run(*words, "--checkpoint", "9", "--output", tmp_path / "out")
    assert code == 0, said
    code, said = run(*words, "--from", tmp_path / "out", "--output", tmp_path / "more")
    assert code == 0, said
    summary = json.loads((tmp_path / "more" / "summary.json").read_text())
    with netCDF4.Dataset(tmp_path / "more" / "results.nc") as file:
        assert summary["start_s"] == file["run"]["time"][0] == pytest.approx(0.02)


def test_a_run_with_faults_goes_on(inputs, run, tmp_path):
    path, out = tmp_path / "faults.json", tmp_path / "out"
    path.write_text(json.dumps(FAULTS))
    words = ["isolation", "--duration", "0.2", "--no-figures", "--faults", str(path)]
    assert run(*words, "--output", tmp_path / "whole")[0] == 0
    again = [*words, "--checkpoint", "0.03", "--output", str(out)]
    done = start(inputs, *again, driver=(str(DRIVER), "names", "18"))
    assert done.returncode == -signal.SIGKILL, done.stderr
    assert 1 <= len(list((out / "checkpoint" / "active").glob("row-*.msgpack"))) <= 2  # it is the second case
    path.write_text(json.dumps({**FAULTS, "end": 0.19}))
    code, said = run("--resume", out)
    assert code == 2
    assert "faults.json has changed since the run began" in said
    path.write_text(json.dumps(FAULTS))
    code, said = run("--resume", out, "--no-figures")
    assert code == 0, said
    assert list_differences(tmp_path / "whole", out) == []


def test_a_run_by_another_scheme_goes_on(inputs, run, tmp_path):
    assert main(["ssp", "--output", str(tmp_path / "own.ssp")]) == 0
    words = [str(tmp_path / "own.ssp"), "--step", "1e-4", "--duration", "0.2", "--observe", "plant.*", "--no-figures"]
    words += ["--scheme", "gauss-seidel", "--extrapolate", "linear", "--rate", "isolator=5"]
    assert run(*words, "--output", tmp_path / "whole")[0] == 0
    again = [*words, "--checkpoint", "0.0303", "--output", str(tmp_path / "out")]
    done = start(inputs, *again, driver=(str(DRIVER), "names", "7"))
    assert done.returncode == -signal.SIGKILL, done.stderr
    code, said = run("--resume", tmp_path / "out", "--no-figures")
    assert code == 0, said
    assert list_differences(tmp_path / "whole", tmp_path / "out") == []


def test_ctrl_c_names_the_command_that_goes_on(inputs, undisturbed, tmp_path):
    words = [*RUNS["isolation"][1], "--no-figures", "--checkpoint", "9", "--output", str(tmp_path / "out")]
    done = start(inputs, *words, driver=(str(DRIVER), "interrupt", "7000"))
    assert done.returncode == 130, done.stderr
    assert f"to go on from the last checkpoint: ps-fmu run --resume {tmp_path / 'out'}" in done.stderr
    assert len(list((tmp_path / "out" / "checkpoint" / "active").glob("row-*.msgpack"))) == 1
    done = start(inputs, "--resume", str(tmp_path / "out"), "--no-figures")
    assert done.returncode == 0, done.stderr
    assert list_differences(undisturbed("isolation")[0], tmp_path / "out") == []


def test_simulate_goes_on(tmp_path, monkeypatch):
    options = {"duration": 0.4, "progress": False, "output": tmp_path / "out", "checkpoint": 0.05}
    whole = ps_fmu.simulate("isolation", duration=0.4, progress=False, output=tmp_path / "whole")
    original, seen = Recorder.block, []

    def fail(self, first_index, time, values):
        seen.append(first_index)
        if len(seen) == 2:
            raise OSError("as if the disk were full")
        original(self, first_index, time, values)

    monkeypatch.setattr(Recorder, "block", fail)
    with pytest.raises(OSError, match="as if"):
        ps_fmu.simulate("isolation", **options)
    monkeypatch.undo()
    for change, words in (
        ({"storage_step": 1e-3}, "another value of --storage-step: None there, 0.001 here"),
        ({"observe": "plant.*"}, "another value of --observe"),
        ({"output": tmp_path / "new"}, "there is no run with checkpoints in"),
    ):
        with pytest.raises(ps_fmu.runs.options.OptionError, match=words):
            ps_fmu.simulate("isolation", **{**options, **change}, resume=True)
    with pytest.raises(ps_fmu.runs.options.OptionError, match="is one of 'isolation', this is one of 'slew'"):
        ps_fmu.simulate("slew", **options, resume=True)
    ps_fmu.simulate("isolation", **options, resume=True)
    assert list_differences(Path(whole.output), tmp_path / "out") == []
    with pytest.raises(ps_fmu.runs.options.OptionError, match="expected the output folder"):
        ps_fmu.simulate("isolation", resume=True)
