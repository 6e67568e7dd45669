"""The room is a library of its own: no FMI, no other room, quick to import."""

import subprocess
import sys

CODE = """
import sys
import ps_fmu.pointing
loaded = {name.split(".")[0] for name in sys.modules}
rooms = {name.split(".")[1] for name in sys.modules if name.startswith("ps_fmu.")}
print(sorted(rooms), sorted(loaded & {"fmpy", "pythonfmu", "control", "netCDF4", "matplotlib", "scipy"}))
"""


def test_nothing_else_is_imported():
    found = subprocess.run([sys.executable, "-I", "-c", CODE], capture_output=True, text=True, check=True)
    assert found.stdout == "['pointing'] []\n"
