"""
Which accelerometer?
====================

The isolator integrates the measured acceleration of the base twice. Noise of the accelerometers
is integrated as well. So each class of parts has a best corner of the isolator's high-pass, and
a jitter that it cannot go below. The closed form gives both in seconds, without any run.
"""

# %%
# Compute the trade
# -----------------
#
# Four classes of real parts, each with a parameter file that names its figures and their
# sources. The disturbance and the mechanism are the default ones. (``ps-fmu analyse sensors``
# computes this on a finer grid and runs the FMUs beside it.)

import matplotlib.pyplot as plt
import numpy as np

from ps_fmu.product.files import find_product
from ps_fmu.trades.sensors.results import MICRO_G, compute_trade, needed_density

corners = np.geomspace(0.01, 4.0, 9)  # Hz
trade = compute_trade(find_product().system / "parameters", corners, points=200)
print(f"passive: {1e6 * trade.passive:.1f} urad")
for crossover, rms in trade.loops_alone.items():
    print(f"isolator off, line-of-sight loop of {crossover:g} Hz: {1e6 * rms:.1f} urad")

# %%
# Jitter over the corner
# ----------------------
#
# Below its best corner a part's noise takes over, above it the disturbance. A line-of-sight loop,
# with a fine guidance sensor or the tracker of a beacon, holds the payload below its crossover.
# There the noise of the accelerometers counts less, so the best corner moves down.

figure, axes = plt.subplots(1, 2, figsize=(9, 4.2), sharey=True, layout="constrained")
for panel, crossover, title in (
    (axes[0], None, "no line-of-sight loop"),
    (axes[1], 1.25, "loop of 1.25 Hz"),
):
    for name, found in trade.classes.items():
        panel.loglog(
            trade.corners,
            1e6 * found.sweeps[crossover].rms,
            marker="o",
            markersize=3,
            label=name,
        )
    without = trade.passive if crossover is None else trade.loops_alone[crossover]
    panel.axhline(1e6 * without, color="0.4", linestyle="--", label="isolator off")
    panel.set(xlabel="corner of the isolator's high-pass (Hz)", title=title)
    panel.grid(True, which="both", alpha=0.3)
axes[0].set_ylabel("jitter of the line of sight, RMS (urad)")
axes[0].legend()

# %%
# The best of each
# ----------------

print(f"{'class':<12}{'ug/sqrt(Hz)':>12}{'alone':>10}{'+ 1.25 Hz':>12}   (urad)")
for name, found in trade.classes.items():
    density = found.sensors.accelerometer.noise_density / MICRO_G
    alone, looped = (1e6 * found.sweeps[crossover].rms.min() for crossover in (None, 1.25))
    print(f"{name:<12}{density:>12.3g}{alone:>10.2f}{looped:>12.2f}")

# %%
# And the other way round: how quiet does the accelerometer have to be for a jitter of 1 urad
# beside the faster loop?

needed = needed_density(trade, 1.25, 1e-6)
print(f"at most {needed / MICRO_G:.1f} ug/sqrt(Hz)")

# %%
# Then run it
# -----------
#
# ``ps-fmu run isolation --system system/InertialSensors.ssd --parameters
# sensors_navigation.ssv`` puts a class into the running system, sampling, range and drift
# included.
