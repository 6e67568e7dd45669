"""system/run.py as its users start it: a process of its own, with the real FMUs."""

import json
import os
import pty
import re
import resource
import signal
import subprocess
import sys
import termios
from pathlib import Path

import netCDF4
import numpy as np
import pytest

ROOT = Path(__file__).parents[2]
COMMAND = [sys.executable, str(ROOT / "system" / "run.py")]
FINISHED_WITHIN_S = 100.0
IMPORTS = """if True:
    import json, sys
    from ps_fmu.run_command import main
    code = main(["isolation", "--duration", "4", "--step", "1e-3", "--no-figures", "--output", "out"])
    large = {"scipy", "matplotlib", "xarray", "pandas", "dask"}
    others = {"ps_fmu.disturbance", "ps_fmu.scenarios.pointing_loop", "ps_fmu.scenarios.slew_results"}
    others |= {"ps_fmu.scenarios.wheels"}
    print(json.dumps([code, sorted((large | others) & set(sys.modules))]))
"""
"""A run imports what it needs: large packages take longer to load than a short run, and other scenarios count."""

pytestmark = pytest.mark.usefixtures("built_fmus")


def started(arguments, folder, figures=False, **others):
    return subprocess.run(
        [*COMMAND, *arguments.split(), *([] if figures else ["--no-figures"])],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=FINISHED_WITHIN_S,
        check=False,
        **others,
    )


def stored_time(path, case="passive"):
    """Times of the rows of a case; every variable has as many."""
    with netCDF4.Dataset(path) as file:
        group = file[case]
        assert {len(variable) for variable in group.variables.values()} == {len(group["time"])}
        return np.array(group["time"][:])


def test_the_default_scenario(tmp_path):
    run = started("--duration 0.2 --step 2e-4 --output out", tmp_path, figures=True)
    assert run.returncode == 0, run.stderr
    assert "rejection (%)" in run.stdout
    assert f"x real time; results in {tmp_path / 'out'}" in run.stdout
    assert re.search(r"active: 100% .* 0\.2/0\.2 s .* x real time", run.stderr)
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert {"summary.json", "results.nc", "report.html", "jitter.png", "spectra.png", "image_point.png"} <= names
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["duration_s"] == 0.2
    for case in ("passive", "active"):
        np.testing.assert_allclose(
            stored_time(tmp_path / "out" / "results.nc", case), np.arange(201) * 1e-3, atol=1e-12
        )


def test_a_requirement_that_is_not_met(tmp_path):
    """The exit code says so; all results are there, and the stored rows have the same verdict."""
    (tmp_path / "strict.toml").write_text(
        "[[requirement]]\nname = 'strict'\nsignal = 'plant.los'\ncombine = 'norm'\nindex = 'APE'\nstatistic = 'rms'\n"
        "confidence = 0.9\nlimit = '1e-9 um'\n"
    )
    run = started("--duration 0.2 --step 1e-3 --requirements strict.toml --output out", tmp_path)
    assert run.returncode == 1
    assert "Requirements: 0 of 1 are met, 1 not met" in run.stdout and "x real time; results in" in run.stdout
    assert "run.py: requirements: 0 of 1 are met, 1 not met" in run.stderr
    (verdict,) = json.loads((tmp_path / "out" / "summary.json").read_text())["verdicts"]
    assert (verdict["index"], verdict["limit"], verdict["met"]) == ("APE", 1e-9, False)
    judge = [sys.executable, "-m", "ps_fmu.cli", "judge", "out/results.nc", "--requirements", "strict.toml"]
    judged = subprocess.run(judge, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert judged.returncode == 1 and "NOT MET" in judged.stdout


def test_without_an_error_stream(tmp_path):
    """As 2>&- starts it: the results are complete, and no file has taken the place of the stream."""
    run = started("--duration 0.02 --step 1e-3 --output out", tmp_path, preexec_fn=lambda: os.close(2))
    assert run.returncode == 0
    assert "rejection (%)" in run.stdout
    np.testing.assert_allclose(stored_time(tmp_path / "out" / "results.nc", "active")[-1], 0.02)


def test_a_full_disk_under_the_standard_output_costs_no_results(tmp_path):
    with open("/dev/full", "w") as full:
        run = subprocess.run(
            [*COMMAND, *["--duration", "0.02", "--step", "1e-3", "--output", "out", "--no-figures"]],
            cwd=tmp_path, stdout=full, stderr=subprocess.PIPE, text=True, timeout=FINISHED_WITHIN_S, check=False,
        )  # fmt: skip
    assert run.returncode == 1
    assert run.stderr.endswith("standard output: No space left on device\n")
    assert {"summary.json", "report.html"} <= set(os.listdir(tmp_path / "out"))


@pytest.mark.parametrize("stop", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_during_a_run_leaves_what_was_simulated(tmp_path, stop):
    """The progress bar on a terminal says when the run is under way."""
    ours, theirs = pty.openpty()
    termios.tcsetwinsize(theirs, (24, 100))
    with subprocess.Popen(
        [*COMMAND, "--duration", "60", "--storage-step", "1e-4", "--output", "out"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=theirs,
        text=True,
    ) as process:
        os.close(theirs)
        shown, sent = "", False
        while True:
            try:
                shown += os.read(ours, 4096).decode(errors="replace")
            except OSError:  # the other end was closed: the process is gone
                break
            if not sent and re.search(r"passive: .* (?!0\.)[\d.]+/60\.0 s", shown):
                process.send_signal(stop)
                sent = True
        output, _ = process.communicate(timeout=FINISHED_WITHIN_S)
    os.close(ours)
    assert process.returncode == 130
    assert output == ""
    assert "run.py: interrupted" in shown
    assert f"results so far: {tmp_path / 'out' / 'results.nc'}" in shown
    time = stored_time(tmp_path / "out" / "results.nc")
    assert len(time) >= 9500  # the bar has shown 1.0 s or more, to a tenth; each step is stored
    np.testing.assert_allclose(time, np.arange(len(time)) * 1e-4, atol=1e-9)
    assert not (tmp_path / "out" / "summary.json").exists()


def test_no_space_for_the_results_ends_the_run_and_keeps_what_is_there(tmp_path):
    """A limit on the size of files stands for a full disk."""
    limit = 6_000_000
    run = started(
        "--duration 20 --storage-step 1e-4 --output out",
        tmp_path,
        preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)),
    )
    assert run.returncode == 1
    assert "results.nc: the file size limit of this process is reached" in run.stderr
    assert "Traceback" not in run.stderr
    time = stored_time(tmp_path / "out" / "results.nc")
    assert len(time) > 1000
    np.testing.assert_allclose(time, np.arange(len(time)) * 1e-4, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "text"),
    [
        ("plant.payload.mass", 0.0, "payload.mass: must be greater than 0"),
        ("plant.payload.mass", float("nan"), "line 4: parameter 'plant.payload.mass': expected a finite number"),
        ("plant.payload.weight", 1.0, "plant.payload.weight (given.ssv, line 4): there is no such variable in"),
    ],
)
def test_what_cannot_be_used_is_named_and_ends_with_1(tmp_path, ssv, name, value, text):
    ssv({name: value})
    run = started("--duration 0.1 --parameters given.ssv --output out", tmp_path)
    assert run.returncode == 1
    assert text in run.stderr
    assert "Traceback" not in run.stderr
    assert run.stderr.endswith("run.py: nothing was stored\n")
    assert not (tmp_path / "out" / "results.nc").exists()


def test_a_step_of_zero_ends_with_2(tmp_path):
    run = started("--step 0 --output out", tmp_path)
    assert run.returncode == 2
    assert "--step: expected a time above 0 s, got 0.0" in run.stderr
    assert not (tmp_path / "out").exists()


def test_a_run_without_figures_does_without_large_packages_and_other_scenarios(built_fmus, tmp_path):
    found = subprocess.run(
        [sys.executable, "-c", IMPORTS], capture_output=True, text=True, timeout=240, cwd=tmp_path, check=True
    )
    assert json.loads(found.stdout.splitlines()[-1]) == [0, []]
