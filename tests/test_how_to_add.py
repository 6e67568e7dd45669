"""docs/developers/how-to-add.md: its examples, written into a copy of the package, are found and run."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "developers" / "how-to-add.md"
EXAMPLES = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
SCENARIOS = ROOT / "src" / "ps_fmu" / "runs" / "scenario.py"
DISTURBANCE = ROOT / "src" / "ps_fmu" / "disturbance"
IMPORTS = (DISTURBANCE / "tones.py").read_text(encoding="utf-8").split("\n\n\n")[0]

RUN_SCENARIO = """
from ps_fmu.runs.run import execute
from ps_fmu.runs.options import RunOptions
from ps_fmu.runs.scenario import SCENARIOS

scenario = SCENARIOS["quiet"]
system, output, fmus = (Path(argument) for argument in sys.argv[2:])
execute(RunOptions(scenario, system, output, 0.01, 1e-3, fmus=fmus, progress=False).claim_output())
"""

MAKE_FORCE = """
import numpy as np
from ps_fmu.disturbance import Disturbance, default_settings
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import replace_values

silent = {"noise.enabled": False, "step_1.force.x": 2.0}
print(Disturbance(replace_values(default_settings(load()), silent))(np.zeros(1))[0].tolist())
"""


@pytest.fixture
def run_in_copy(tmp_path):
    """Writes files into a copy of the package and runs a program with that copy; returns what it prints."""

    def run(places, program, *arguments):
        package, without = tmp_path / "src" / "ps_fmu", shutil.ignore_patterns("__pycache__")
        shutil.copytree(ROOT / "src" / "ps_fmu", package, ignore=without)
        for folder in ("fmus", "system"):
            (tmp_path / folder).symlink_to(ROOT / folder)
        for place, text in places.items():
            (package / place).write_text(text, encoding="utf-8")
        program = f"import sys; from pathlib import Path; sys.path.insert(0, sys.argv[1])\n{program}"
        command = [sys.executable, "-I", "-B", "-c", program, str(tmp_path / "src"), *map(str, arguments)]
        done = subprocess.run(command, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    return run


def test_a_scenario_is_one_file(run_in_copy, built_fmus, tmp_path):
    system = ROOT / "system" / "SystemStructure.ssd"
    begin = "    for scenario in (\n"
    table = SCENARIOS.read_text(encoding="utf-8").replace(begin, begin + EXAMPLES[1])
    files = {"scenarios/quiet.py": EXAMPLES[0], "runs/scenario.py": table}
    printed = run_in_copy(files, RUN_SCENARIO, system, tmp_path / "out", built_fmus)
    assert printed.startswith("[0. 0. 0.]\n")
    assert (tmp_path / "out" / "report.html").is_file()


def test_a_kind_of_disturbance_is_one_file(run_in_copy):
    end = "RecordingSettings)\n"
    total = (DISTURBANCE / "total.py").read_text(encoding="utf-8").replace(end, "RecordingSettings, StepSettings)\n")
    total = total.replace("from .tones import", "from .steps import StepSettings\nfrom .tones import")
    files = {"disturbance/steps.py": f"{IMPORTS}\n\n{EXAMPLES[2]}", "disturbance/total.py": total}
    printed = run_in_copy(files, MAKE_FORCE)
    assert printed == "[2.0, 0.0, 0.0, 0.0, 0.0, 0.0]\n"
