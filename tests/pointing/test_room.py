"""The room is a library of its own: quick to import, and its document prints what it says."""

import doctest
import subprocess
import sys
from pathlib import Path

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


DOCUMENT = Path(__file__).parents[2] / "docs" / "pointing.md"


def test_the_examples_print_what_they_say():
    found = doctest.testfile(str(DOCUMENT), module_relative=False)
    assert found.failed == 0
    assert found.attempted >= 25
