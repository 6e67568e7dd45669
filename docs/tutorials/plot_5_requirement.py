"""
A requirement from start to verdict
===================================

"The relative pointing error over 1 s stays below 0.5 urad for 95 % of the time, with 90 %
confidence." This tutorial writes that down, runs the system for 90 s, and reads the verdict and
its margin. Then it asks which frequencies the error comes from, and where the limit would be
too tight.
"""

# %%
# Write it down
# -------------
#
# A requirement names a signal, an index of ECSS-E-ST-60-10C with its window, a statement on its
# distribution, and a limit with its unit. ``docs/requirements.md`` explains each key.

import tempfile
from pathlib import Path

REQUIREMENTS = """
[[requirement]]
name = "blur of an exposure"
signal = "plant.payload_rotation"
case = "active"
settling = "5 s"
index = "RPE"
at = "uniform"
window = "1 s"
probability = 0.95
confidence = 0.9
interpretation = "temporal"
limit = "0.5 urad"

[[requirement]]
name = "residual jitter"
signal = "plant.payload_rotation"
settling = "5 s"
index = "jitter"
window = "100 ms"
statistic = "rms"
confidence = 0.9
limit = "0.06 urad"
"""
folder = tempfile.TemporaryDirectory()
requirements = Path(folder.name) / "requirements.toml"
requirements.write_text(REQUIREMENTS)

# %%
# Run and judge
# -------------
#
# ``ps-fmu run isolation --requirements requirements.toml`` judges every step while it runs.
# Here the stored rows of a run are judged, as ``ps-fmu judge results.nc --requirements
# requirements.toml`` does.

import ps_fmu
from ps_fmu.requirements.requirement import read_requirements
from ps_fmu.requirements.stored import judge_files

result = ps_fmu.simulate(
    "isolation", duration=90, progress=False, output=Path(folder.name) / "run"
)
results = Path(result.output) / "results.nc"


def show(verdicts):
    for verdict in verdicts:
        value, bound, limit = (
            1e6 * n for n in (verdict.statement.value, verdict.statement.bound, verdict.limit)
        )
        print(
            f"{verdict.requirement.name:<20} {verdict.signal[-1]}  {verdict.answer:<10}"
            f"{value:.3f}, at most {bound:.3f} of {limit:.2f} urad: margin {verdict.margin_percent:+3.0f} %"
        )


verdicts = judge_files([results], read_requirements(requirements))
show(verdicts)

# %%
# The remarks say what the numbers do not tell:

for remark in dict.fromkeys(verdict.remark for verdict in verdicts if verdict.remark):
    print(remark)

# %%
# **Value** is the best estimate from this run. **At most** is what the true value stays below
# with 90 % confidence: that is compared with the limit. A longer run knows better, so its bound
# is lower.
#
# Where does the error come from?
# -------------------------------
#
# The weight of an index says which frequencies count. The relative error over 1 s forgives what
# is slower than a second; the residual jitter over 100 ms forgives drifts in the exposure as
# well.

import matplotlib.pyplot as plt
import numpy as np
from scipy.signal import welch

from ps_fmu.pointing import RelativeError, ResidualJitter

record = result.active["payload_rotation"].sel(axis="z").sel(time=slice(5.0, None)).values
frequency, density = welch(record, fs=1000.0, nperseg=8192)
indices = {"RPE, 1 s": RelativeError(1.0, at="uniform"), "jitter, 100 ms": ResidualJitter(0.1)}
figure, (above, below) = plt.subplots(2, 1, figsize=(8, 6), sharex=True, layout="constrained")
for label, index in indices.items():
    weight = index.weight(frequency)
    above.semilogx(frequency[1:], weight[1:], label=label)
    below.semilogx(
        frequency[1:],
        1e6 * np.sqrt(np.cumsum(weight * density * frequency[1]))[1:],
        label=label,
    )
above.set(ylabel="weight", title="Payload rotation about z, isolator on")
below.set(xlabel="frequency (Hz)", ylabel="cumulative RMS (urad)", xlim=(0.3, 400.0))
for panel in (above, below):
    panel.grid(True, which="both", alpha=0.3)
    panel.legend()

# %%
# Both grow most near 5 Hz, where the suspension resonates and the isolator's delay leaves a
# part of the disturbance. The relative error takes nearly all of it.
#
# Tighten the limit
# -----------------
#
# The same results can be judged again. With half the limit the verdict depends on the axis: about
# y it is met. The best estimates about x and z lie below 0.25 urad, but their bounds do not: that
# the requirement is met is not shown.

requirements.write_text(REQUIREMENTS.replace("0.5 urad", "0.25 urad"))
tighter = judge_files([results], read_requirements(requirements))
show(tighter[:3])
folder.cleanup()

# %%
# ``ps-fmu judge`` ends with exit code 1 then, so a script or a continuous integration notices.
# A longer run lowers the bound, not the value; a better isolator lowers both. ``--parameters
# exact_payload.ssv`` gives one that knows the payload's centre of mass.
