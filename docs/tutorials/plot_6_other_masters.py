"""
The FMUs in OMSimulator and other masters
=========================================

One file carries the whole system: FMUs, wiring, start values (SSP 1.0). OMSimulator, libcosim,
Ecos and FMPy read it. This tutorial writes the file, runs it in what is installed, and compares
the results with those of our own master.
"""

# sphinx_gallery_thumbnail_path = "docs/loop.svg"

# %%
# Export the system
# -----------------
#
# On the command line: ``ps-fmu ssp --output pointing.ssp``. ``--parameters my.ssv`` puts other
# start values in, ``--system`` takes another system description.

import os
import shutil
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

from ps_fmu.cosim import Master, read_system, write_ssp
from ps_fmu.product.files import find_product
from ps_fmu.runs.built_fmus import find_built_folder

STEP, STEPS = 1e-4, 2000  # s
folder = tempfile.TemporaryDirectory()
archive = Path(folder.name) / "pointing.ssp"
write_ssp(
    read_system(find_product().system / "SystemStructure.ssd", find_built_folder()), archive
)
with zipfile.ZipFile(archive) as opened:
    for entry in opened.infolist():
        print(f"{entry.file_size / 1e3:8.0f} kB  {entry.filename}")

# %%
# Our own master
# --------------
#
# It is the reference for the others. ``base_acceleration.x`` of the plant is an input of the
# isolator, in m/s2.

with Master(read_system(archive), step=STEP) as master:
    master.initialise()
    master.run(STEPS * STEP)
    reference = master.get("plant.base_acceleration.x")
print(f"our master: {reference:.9e} m/s2 after {STEPS} steps")


def compare(tool, value):
    """Print a tool's result beside ours."""
    print(f"{tool}: {value:.9e} m/s2, relative difference {abs(value / reference - 1.0):.0e}")


# %%
# OMSimulator
# -----------
#
# OMSimulator takes the step from the file. It runs no Python itself: ``PS_FMU_PYTHON`` names
# one that has numpy and scipy, and ``ps-fmu build --bundle`` would put one into the FMUs
# instead::
#
#     PS_FMU_PYTHON=$(which python3) OMSimulator --stopTime=0.2 --resultFile=results.csv pointing.ssp
#
# Where the command is installed it is run here.

program = shutil.which("OMSimulator")
if program is None:
    print("OMSimulator is not installed: not run")
else:
    table = Path(folder.name) / "results.csv"
    subprocess.run(
        [program, f"--stopTime={STEPS * STEP}", f"--resultFile={table}", str(archive)],
        check=True,
        cwd=folder.name,
        env=os.environ | {"PS_FMU_PYTHON": sys.executable},
        capture_output=True,
    )
    header, *rows = [
        line.replace('"', "").split(",") for line in table.read_text().splitlines()
    ]
    place = next(
        k for k, name in enumerate(header) if name.endswith("plant.base_acceleration.x")
    )
    compare("OMSimulator", float(rows[-1][place]))

# %%
# libcosim
# --------
#
# libcosim is the engine of the Open Simulation Platform; ``pip install libcosimpy``. Its result
# agrees with ours to about 1e-9: it adds up times with rounding of its own.

try:
    from libcosimpy.CosimExecution import CosimExecution
    from libcosimpy.CosimLogging import CosimLogLevel, log_output_level
    from libcosimpy.CosimObserver import CosimObserver
except ImportError:
    print("libcosimpy is not installed: not run")
else:
    log_output_level(CosimLogLevel.ERROR)
    execution = CosimExecution.from_ssp_file(str(archive))
    observer = CosimObserver.create_last_value()
    execution.add_observer(observer)
    execution.step(STEPS)
    plant = execution.slave_index_from_instance_name("plant")
    variables = execution.slave_variables(plant)
    wanted = next(
        variable.reference for variable in variables if variable.name == b"base_acceleration.x"
    )
    compare("libcosim", observer.last_real_values(plant, [wanted])[0])

# %%
# FMPy
# ----
#
# FMPy's own master labels its rows one step early: ours is the last row but one.

from fmpy.ssp.simulation import simulate_ssp

rows = simulate_ssp(str(archive), stop_time=STEPS * STEP, step_size=STEP)
compare("FMPy", rows["plant.base_acceleration.x"][-2])
folder.cleanup()

# %%
# ``fmus/README.md`` has recipes for Ecos, FMU containers, PathSim, CoFMUPy, Simulink and
# Dymola, and the table of what was run in which version.
