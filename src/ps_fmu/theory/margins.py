"""Margins of the internal loop as the paper reads them: one element of +L against the point -1, as a Bode diagram."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from ..mechanism.quantities import Array, Complex
from .loop import Loop
from .transfer_matrices import place_frequencies


@dataclass(frozen=True)
class Margins:
    """One element of L as a Bode diagram: what Fig 10 and section 4.2 state."""

    largest_gain_db: float
    largest_gain_at: float
    """Hz."""
    gain_crossings: tuple[float, ...]
    """Hz, where the gain passes 0 dB."""
    phase_crossings: tuple[float, ...]
    """Hz, where the phase passes -180 deg while the gain is above 0 dB."""
    phase_margin: float
    """deg, phase above -180 deg at the last gain crossing; nan without one."""


def element_margins(loop: Loop, band: tuple[float, float], row: int = 0, column: int = 0) -> Margins:
    """Margins of +L[row, column] against the point -1, over a band of frequencies, Hz."""

    def element(f: ArrayLike) -> Complex:
        return loop.transfer(2j * np.pi * np.asarray(f))[..., row, column]

    return margins(element, place_frequencies(loop.plant_poles(), *band, 1500))


def margins(element: Callable[[ArrayLike], Complex], frequency: Array) -> Margins:
    """Margins of a function of frequency (Hz) against the point -1.

    It is searched at the frequencies (n,), and then followed between them.
    """
    from scipy.optimize import minimize_scalar

    def gain(value: Complex) -> Array:
        return np.asarray(20.0 * np.log10(np.abs(value)))

    def phase(value: Complex) -> Array:
        """Distance from -180 deg, deg, between -180 and 180."""
        return np.asarray(np.degrees(np.angle(-value)))

    values = element(frequency)
    gains = gain(values)
    crossings = _roots(lambda f: gain(element(f)), frequency, gains)
    turning = _roots(lambda f: phase(element(f)), frequency, phase(values), jump=180.0)
    turning = [f for f in turning if gain(element(f)) > 0.0]
    margin = float(phase(element(crossings[-1]))) if crossings else np.nan
    top = int(np.clip(gains.argmax(), 1, len(frequency) - 2))
    around = (frequency[top - 1], frequency[top + 1])
    peak = minimize_scalar(lambda f: -gain(element(f)), bounds=around, method="bounded")
    return Margins(-float(peak.fun), float(peak.x), tuple(crossings), tuple(turning), margin)


def _roots(f: Callable[[float], Array], x: Array, y: Array, jump: float = np.inf) -> list[float]:
    """Where f, with values y at the points x, passes zero, but for jumps larger than ``jump``."""
    from scipy.optimize import brentq

    places = np.flatnonzero((np.sign(y[1:]) != np.sign(y[:-1])) & (np.abs(np.diff(y)) < jump))
    return [float(brentq(f, x[k], x[k + 1], xtol=1e-12 * x[k])) for k in places]
