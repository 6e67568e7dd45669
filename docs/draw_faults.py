"""Draws faults.png and prints the numbers of faults.md: what the shipped faults do to the line of sight.

Usage: python docs/draw_faults.py [OUTPUT.png]

It needs the FMUs (make fmus) and takes a minute.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from ps_fmu.cosim import Master, read_system
from ps_fmu.cosim.faults.reading import read_faults
from ps_fmu.results.observers.sampler import HistoryObserver
from ps_fmu.results.style import ACTIVE, PASSIVE, draw, shade

ROOT = Path(__file__).parents[1]
EXAMPLES = {  # file: system, s to simulate
    "accelerometer_fails": ("InertialSensors.ssd", 20.0),
    "voice_coil_sticks": ("VoiceCoils.ssd", 20.0),
    "tracker_loses_lock": ("LineOfSight.ssd", 53.0),
}
ROTATION = [f"plant.payload_rotation.{axis}" for axis in "xy"]


def simulate(name, step=1e-4, faulty=True, duration=None):
    """Times (n,) [s], angle of the line of sight to where it looked at first (n,) [rad], the faults that acted."""
    system, whole = EXAMPLES[name]
    faults = read_faults(ROOT / "system" / "faults" / f"{name}.json") if faulty else None
    with Master(read_system(ROOT / "system" / system, ROOT / "build" / "fmus"), step, faults=faults) as master:
        master.initialise()
        observer = HistoryObserver(master.columns, ROTATION)
        master.run(duration or whole, [observer])
        acted = master.faults.list_acted(master.time)
    angle = np.hypot(*observer.result())
    return step * np.arange(len(angle)), angle, acted


def find_rms(values):
    """Root of the mean of the squares."""
    return np.sqrt(np.mean(values**2))


def main(path):
    """Draw the figure, print the numbers."""
    found = {name: (simulate(name, faulty=False), simulate(name)) for name in EXAMPLES}
    for name, ((time, healthy, _), (_, faulty, acted)) in found.items():
        print(name)
        for fault in acted:
            there = (time >= fault.from_s) & (time <= fault.until_s)
            rms, peak = ([f(x[there]) * 1e6 for x in (healthy, faulty)] for f in (find_rms, np.max))
            print(f"  {fault.text}: RMS {rms[0]:.2f} -> {rms[1]:.2f} urad, peak {peak[0]:.2f} -> {peak[1]:.2f} urad")

    def paint(figure):
        for axes, (name, (plain, faulty)) in zip(figure.subplots(len(found), 1), found.items(), strict=True):
            axes.semilogy(faulty[0], faulty[1] * 1e6, color=PASSIVE, lw=1.2, label="with the fault")
            axes.semilogy(plain[0], plain[1] * 1e6, color=ACTIVE, lw=0.8, label="without")
            shade(axes, {(fault.from_s, fault.until_s) for fault in faulty[2]})
            axes.set_title(f"{name}.json", loc="left")
            axes.set_ylim(1e-2, None)
            axes.set_xlim(0.0, plain[0][-1])
            axes.set_ylabel("error (\N{MICRO SIGN}rad)")
        figure.axes[0].legend(loc="lower right", ncols=2)
        figure.axes[-1].set_xlabel("time (s)")

    draw(path, 11.0, 9.0, paint)


if __name__ == "__main__":
    main(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).with_name("faults.png"))
