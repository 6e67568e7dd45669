"""
My instrument, from nothing to verdict, budget, study and own controller
========================================================================

A telescope of 6.5 kg is to point from a satellite of 85 kg, which has a solar array and a cooler.
Does it blur its exposures? Which noise decides? What if the stiffness is not what I think? And is
my own controller better? You type four small files and eight commands.
"""

# %%
# Describe the instrument
# -----------------------
#
# One TOML file states what differs from the published instrument; units are SI. B is the frame of
# the base on the satellite, P that of the payload platform. The satellite is free: it has no
# attitude control.

import os
import shlex
import subprocess
import sys
import tempfile
from pathlib import Path

folder = tempfile.TemporaryDirectory()
os.chdir(folder.name)

Path("telescope.toml").write_text("""
base = "paper"
[manipulator]
scale = 0.5                                      # half the size
fine_legs = { stiffness = 8.0e3, damping = 60.0 }  # N/m, N.s/m
[payload]
mass = 6.5                                       # kg
com_P = [0.0, 0.0, 0.08]                         # m
inertia_P = [[0.09, 0.0, 0.0], [0.0, 0.09, 0.0], [0.0, 0.0, 0.05]]  # kg.m2
truss_modes = []
[bus]
mass = 85.0                                      # kg, the array included
com_B = [0.0, 0.0, -0.35]                        # m
inertia_B = [[14.0, 0.0, 0.0], [0.0, 9.0, 0.0], [0.0, 0.0, 16.0]]   # kg.m2
[[bus.appendage]]                                # the solar array on its hinge
mass = 4.0                                       # kg
com_B = [0.0, 0.9, -0.35]                        # m
inertia_B = [[0.35, 0.0, 0.0], [0.0, 0.1, 0.0], [0.0, 0.0, 0.45]]   # kg.m2
hinge_B = [0.0, 0.35, -0.35]                     # m
axis_B = [1.0, 0.0, 0.0]
frequency = 1.3                                  # Hz
damping_ratio = 0.005
[start.disturbance]
noise.scale = 0.0003                             # of the noise of a large spacecraft
tone_1 = { frequency = 52.0, force = [0.0, 0.1, 0.0] }              # Hz, N: the cooler
""")


def run(command):
    """Type a command into a terminal."""
    program, *words = shlex.split(command)
    print(f"$ {command}", flush=True)
    done = subprocess.run(
        [Path(sys.executable).with_name(program), *words], capture_output=True, text=True
    )
    print(done.stdout or done.stderr)


run("ps-fmu parameters telescope.toml --output telescope.ssv")

# %%
# Is the loop stable?
# -------------------
#
# ``Instrument.ssd`` has seismic accelerometers before the isolator and voice coils behind it. The
# forces of the isolator shake the light satellite, whose acceleration it measures: that is a loop.

run("ps-fmu analyse stability --system Instrument.ssd --parameters telescope.ssv")

# %%
# It is stable, but a gain that is 0.5 dB larger makes it unstable at 222 Hz, where the rods of the
# coarse legs resonate. A lower low-pass of the isolator helps.

with Path("telescope.toml").open("a") as file:
    file.write("[filters]\nlowpass_stop_frequency = 500.0  # Hz, in place of 1000\n")
run("ps-fmu parameters telescope.toml --output telescope.ssv")
run("ps-fmu analyse stability --system Instrument.ssd --parameters telescope.ssv")

# %%
# All three legs together have a gain margin of 12.7 dB.
#
# State what you require, and run
# -------------------------------
#
# ``passive`` is the run without the isolator, ``active`` that with it.

Path("requirements.toml").write_text("""
[[requirement]]
name = "blur of 0.1 s"
signal = "plant.payload_rotation"
case = ["passive", "active"]
settling = "4 s"
index = "jitter"
window = "0.1 s"
statistic = "rms"
confidence = 0.9
limit = "0.2 urad"
[[requirement]]
name = "stability over 1 s"
signal = "plant.payload_rotation"
case = ["passive", "active"]
settling = "4 s"
index = "RPE"
at = "uniform"
window = "1 s"
statistic = "rms"
confidence = 0.9
limit = "0.9 urad"
""")
run(
    "ps-fmu run isolation --system Instrument.ssd --parameters telescope.ssv"
    " --requirements requirements.toml --duration 40 --output results"
)

# %%
# ``results/report.html`` shows the same with histories and spectra. With the isolator everything
# is met. Without it the stability over 1 s is not.
#
# Where does the error come from?
# -------------------------------

run(
    "ps-fmu analyse budget --system Instrument.ssd --parameters telescope.ssv"
    " --requirements requirements.toml --output budget"
)
