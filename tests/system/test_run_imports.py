"""A run imports what it needs: large packages take longer to load than a short run takes, and other scenarios count."""

import json
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
SCRIPT = """if True:
    import json, sys
    from ps_fmu.run_command import main
    code = main(["isolation", "--duration", "4", "--step", "1e-3", "--no-figures", "--output", "out"])
    large = {"scipy", "matplotlib", "xarray", "pandas", "dask"}
    others = {"ps_fmu.disturbance", "ps_fmu.scenarios.pointing_loop", "ps_fmu.scenarios.slew_results"}
    others |= {"ps_fmu.scenarios.wheels"}
    print(json.dumps([code, sorted((large | others) & set(sys.modules))]))
"""


def test_a_run_without_figures_does_without_large_packages_and_other_scenarios(built_fmus, tmp_path):
    found = subprocess.run(
        [sys.executable, "-c", SCRIPT], capture_output=True, text=True, timeout=240, cwd=tmp_path, check=True
    )
    assert json.loads(found.stdout.splitlines()[-1]) == [0, []]
