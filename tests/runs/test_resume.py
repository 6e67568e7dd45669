"""Runs that are killed and gone on with: their results are those of a run that nobody disturbed, to the last bit.

``PS_FMU_KILLS=30`` disturbs each scenario so often, instead of twice.
"""

import os
import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.same_results import list_differences

ROOT = Path(__file__).parents[2]
DRIVER = ROOT / "tests" / "support" / "killed.py"
KILLS = int(os.environ.get("PS_FMU_KILLS", "2"))
RUNS = {
    # Two cases of 6001 rows: blocks of 2000, a checkpoint each 700.
    "isolation": (12_002, ["isolation", "--duration", "0.6", "--requirements", "own.toml"]),
    "slew": (5_602, ["slew", "--duration", "1.4", "--step", "5e-4", "--parameters", "noise.ssv"]),
}
NAMES = 26
"""About as often do files get a name in such a run."""
REQUIREMENTS = """
[[requirement]]
name = "blur"
signal = "plant.payload_rotation"
index = "RPE"
at = "uniform"
window = "50 ms"
probability = 0.95
confidence = 0.9
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
confidence = 0.9
limit = "1 mm"
"""


def start(folder, *words, driver=()):
    program = [sys.executable, "-I", *(driver or ("-m", "ps_fmu.cli")), "run", *words]
    return subprocess.run(program, cwd=folder, capture_output=True, text=True, timeout=120.0, check=False)


def tables(printed):
    """What a run prints, but for its last line, which has the real-time factor."""
    return printed.splitlines()[:-1]


@pytest.fixture(scope="module")
def inputs(tmp_path_factory, built_fmus):
    """A folder with the files that the runs use, and the results of those that nobody disturbs."""
    from conftest import HEAD

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
        again = ("rows", str(rng.randrange(2 * rows)))  # perhaps it is killed again
        done = start(inputs, "--resume", str(tmp_path / "out"), "--no-figures", driver=(str(DRIVER), *again))
    assert done.returncode == expected.returncode, done.stderr
    assert list_differences(folder, tmp_path / "out") == []
    assert tables(done.stdout) == tables(expected.stdout)
