"""
Your own payload and bus
========================

The default instrument is that of the published paper. Yours has another mass and flies on
another bus. You write down what differs, and one function turns it into start values of all
FMUs.
"""

# %%
# Describe it
# -----------
#
# A TOML file with what differs from the paper's instrument; the units are SI. This one is a
# telescope of 45 kg on a satellite of 300 kg with a solar array whose first mode lies at 0.8
# Hz. B is the frame of the base of the manipulator on the bus, P that of the payload platform.

import tempfile
from pathlib import Path

INSTRUMENT = """
base = "paper"

[payload]
mass = 45.0                # kg
com_P = [0.0, 0.0, 0.15]   # m
inertia_P = [[3.1, 0.0, 0.0], [0.0, 3.1, 0.0], [0.0, 0.0, 1.5]]  # kg.m2, about the centre of mass

[bus]
mass = 300.0               # kg
com_B = [0.0, 0.0, -0.4]   # m
inertia_B = [[190.0, 0.0, 0.0], [0.0, 140.0, 0.0], [0.0, 0.0, 180.0]]  # kg.m2

[[bus.appendage]]          # a solar array; the mass of the bus above includes it
mass = 20.0                # kg
com_B = [0.0, 1.9, -0.4]   # m
inertia_B = [[9.6, 0.0, 0.0], [0.0, 1.1, 0.0], [0.0, 0.0, 10.7]]  # kg.m2
hinge_B = [0.0, 0.7, -0.4] # m
axis_B = [1.0, 0.0, 0.0]
frequency = 0.8            # Hz, with the bus held
damping_ratio = 0.005

[start.disturbance]        # any parameter of a single FMU
noise.scale = 0.05
"""
folder = tempfile.TemporaryDirectory()
file = Path(folder.name) / "instrument.toml"
file.write_text(INSTRUMENT)

# %%
# On the command line: ``ps-fmu parameters instrument.toml --output instrument.ssv``. The same
# in Python:

from ps_fmu.interface.instrument_file import write_start_values
from ps_fmu.product.files import find_product
from ps_fmu.runs.built_fmus import find_built_folder

values = file.with_suffix(".ssv")
system = find_product().system / "SystemStructure.ssd"
lines = write_start_values(file, values, system, find_built_folder())
print(lines[0].removeprefix(f"{values}  "))
print("\n".join(lines[1:]))

# %%
# Run it
# ------

import ps_fmu

result = ps_fmu.simulate(
    "isolation", duration=6, parameter_files=[values], progress=False
)
for axis, passive, rejection in zip(
    "xyz", result.summary["rms_passive_rad"], result.summary["rejection_percent"], strict=True
):
    print(
        f"{axis}: {1e6 * passive:6.1f} urad without the isolator, {rejection:.1f} % less with it"
    )

# %%
# The isolator knows this payload exactly, since the file says nothing else.
#
# What if the isolator is wrong about the payload?
# ------------------------------------------------
#
# Plant and isolator have their own copies of the mechanism. Set them apart on purpose: the
# isolator takes the centre of mass 10 mm aside. ``apart`` says that this is meant; otherwise
# the run warns.

wrong = ps_fmu.simulate(
    "isolation",
    duration=6,
    parameter_files=[values],
    parameters={"isolator.payload.com.x": 0.010},
    apart=["isolator.payload.com"],
    progress=False,
)

# %%
# The payload's rotation with an isolator that knows, and with one that does not:

import matplotlib.pyplot as plt

figure, rows = plt.subplots(3, 1, figsize=(8, 6), sharex=True, layout="constrained")
for row, axis in zip(rows, "xyz", strict=True):
    for found, label in ((wrong, "centre of mass 10 mm off"), (result, "known exactly")):
        rotation = found.active["payload_rotation"].sel(axis=axis)
        row.plot(rotation.time, 1e6 * rotation, label=label, linewidth=0.8)
    row.set_ylabel(f"{axis} (urad)")
    row.grid(True, alpha=0.3)
rows[0].legend(loc="upper right")
rows[0].set_title("Payload rotation, isolator on")
rows[-1].set_xlabel("time (s)")

# %%
# The error lies across z: translation of the bus along y now turns the payload about z.

for axis, exact, off in zip(
    "xyz", result.summary["rms_active_rad"], wrong.summary["rms_active_rad"], strict=True
):
    print(f"{axis}: {1e6 * exact:.3f} urad when known, {1e6 * off:.3f} urad when 10 mm off")
folder.cleanup()

# %%
# ``system/parameters/README.md`` explains the whole form: hinges about several axes, the scale
# of the mechanism, inherited buses, and systems with more FMUs.
