"""Margins of the line-of-sight loop, and its design, by python-control.

The loop is cut open at one axis of P while the others stay closed.  The plant has a pure delay, a notch and nearly
undamped modes, so python-control is given its frequency response, dense around the resonances.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..mechanism.quantities import Array, Complex
from .line_of_sight import PointingLoop, cut_axis

AXES = ("x", "y", "z")

#: What a design has to keep: gain margin in dB, phase margin in deg.
LEAST_GAIN_DB, LEAST_PHASE_DEG = 6.0, 30.0


@dataclass(frozen=True)
class AxisMargins:
    """Margins of one axis with the others closed."""

    axis: str
    gain_db: float
    """Least distance of the gain from 0 dB where the phase is -180 deg, either way; inf: it is nowhere."""
    phase_deg: float
    """Least phase above -180 deg where the gain is 0 dB."""
    crossover_hz: float
    """Where that is."""
    modulus: float
    """Least distance of the loop transfer from -1: 1 over the peak of its sensitivity."""

    @property
    def met(self) -> bool:
        """At least 6 dB and 30 deg."""
        return self.gain_db >= LEAST_GAIN_DB and self.phase_deg >= LEAST_PHASE_DEG


def find_margins(pointing: PointingLoop, frequency: Array | None = None) -> tuple[AxisMargins, ...]:
    """Margins of the three axes in closed form, at frequencies (n,), Hz."""
    frequency = pointing.frequencies() if frequency is None else frequency
    L = pointing.transfer(2j * np.pi * frequency)
    return tuple(margins_of(frequency, cut_axis(L, k), axis) for k, axis in enumerate(AXES))


def margins_of(frequency: Array, response: Complex, axis: str) -> AxisMargins:
    """Margins of a loop transfer (n,) at frequencies (n,), Hz, against the point -1, by python-control."""
    from control import frd, stability_margins  # 1 s to import

    found = stability_margins(frd(response, 2.0 * np.pi * frequency, smooth=True), returnall=True)
    gains, phases, moduli, _, crossings, _ = (np.atleast_1d(values) for values in found)
    gain_db = np.abs(20.0 * np.log10(gains))
    least = int(np.argmin(phases)) if phases.size else None
    return AxisMargins(
        axis,
        gain_db=float(gain_db.min()) if gain_db.size else np.inf,
        phase_deg=float(phases[least]) if least is not None else np.inf,
        crossover_hz=float(crossings[least] / (2.0 * np.pi)) if least is not None else np.nan,
        modulus=float(moduli.min()) if moduli.size else float(np.abs(1.0 + response).min()),
    )


def fastest_crossover(
    pointing: PointingLoop,
    *,
    gain_db: float = LEAST_GAIN_DB,
    phase_deg: float = LEAST_PHASE_DEG,
    tolerance: float = 0.01,
) -> float:
    """Highest crossover frequency, Hz, that keeps the margins of all axes, within a relative ``tolerance``.

    The ratio of integral to crossover frequency stays as it is in the design of ``pointing``; so does the roll-off.
    By bisection between a hundredth and the whole of the roll-off's corner.

    Raises
    ------
    ValueError: not even a hundredth of the corner keeps them.
    """
    design = pointing.control.design
    ratio = design.integral_frequency / design.crossover_frequency
    frequency = pointing.frequencies()
    s = np.asarray(2j * np.pi * frequency, dtype=complex)
    notched = np.asarray(pointing.plant(s) @ pointing.control.notch.response(s), dtype=complex)
    plant = notched * pointing.timing.factor(s)[:, None, None]

    def keeps(crossover: float) -> bool:
        new = replace(design, crossover_frequency=crossover, integral_frequency=ratio * crossover)
        L = plant * new.response(s)[:, None, None]
        found = [margins_of(frequency, cut_axis(L, k), axis) for k, axis in enumerate(AXES)]
        return all(one.gain_db >= gain_db and one.phase_deg >= phase_deg for one in found)

    low, high = 0.01 * design.rolloff_frequency, design.rolloff_frequency
    if not keeps(low):
        raise ValueError(f"no crossover from {low:g} Hz on keeps {gain_db:g} dB and {phase_deg:g} deg")
    while high > low * (1.0 + tolerance):
        middle = float(np.sqrt(low * high))
        low, high = (middle, high) if keeps(middle) else (low, middle)
    return low
