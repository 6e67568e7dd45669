"""A waterfall made without running anything: one harmonic, one mode, and where they meet."""

from __future__ import annotations

import numpy as np

from ps_fmu.results.waterfall import CasePanel, Harmonic, ModeLine, Place, Waterfall

TOP_RPM, MODE_HZ, ORDER = 6000.0, 60.0, 1.5
FLOOR, PEAK = 1e-9, 1e-5  # rad


def make_waterfall(name: str = "wheel_1", case: str = "passive") -> Waterfall:
    """Amplitudes of ``PEAK`` on the line of the harmonic, a tenth in the second panel, and ``FLOOR`` elsewhere."""
    speed, frequency = np.linspace(0.0, TOP_RPM, 101), np.linspace(0.0, 200.0, 401)
    line = ORDER * speed / 60.0
    amplitude = np.full((len(speed), len(frequency)), FLOOR)
    amplitude[np.abs(frequency - line[:, None]) < 0.6] = PEAK
    mark = Place(MODE_HZ, 60.0 * MODE_HZ / ORDER, f"{name}, tower mode")
    return Waterfall(
        title=f"Waterfall of {name}",
        caption="Speed and frequency.",
        label=f"speed of {name}",
        ordinate_unit="rpm",
        unit="rad",
        ordinate=speed,
        frequency=frequency,
        panels=[CasePanel(case, amplitude, mark), CasePanel("active", 0.1 * amplitude)],
        lines=[Harmonic(name, ORDER, line), Harmonic(name, 3.0, 2.0 * line)],
        modes=[ModeLine("tower mode", MODE_HZ), ModeLine("mast mode 1", 140.0), ModeLine("mast mode 2", 141.0)],
    )
