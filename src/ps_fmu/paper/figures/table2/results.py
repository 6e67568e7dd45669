"""Table 2 and Fig 9: the closed forms of an orientation beside its runs."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ....disturbance import multisine_lines, psd_at_origin
from ....mechanism.parameters import Array, Parameters
from ....pointing.rejection import rejection_percent
from ....scenarios.comparison import Comparison
from ....theory.loop import loop_at
from ....theory.transmissibility import Jitter, jitter, jitter_density, jitter_of_lines
from .closed_form import LOOP_DELAY, ORIENTATIONS, closed_form
from .scenario import Measurement

EDGES = (0.1, 0.2, 2.0, 20.0, 1000.0)  # Hz, of the bands whose shares of the variance are shown


@dataclass(frozen=True, eq=False)
class OrientationResult:
    """One orientation.  Lists of two: passive, active."""

    name: str
    theory: tuple[Jitter, Jitter]
    """Closed form from the density, without the delay of the communication step."""
    delayed: Jitter
    """The active one with the delay."""
    lines: tuple[Jitter, Jitter]
    """Closed form for the lines that the disturbance has in the runs, with the delay."""
    fitted_delay: float
    """The delay, in steps, at which the closed form for the lines comes closest to the active runs."""
    measured: Comparison
    """As co-simulated."""

    @property
    def rms(self) -> Array:
        """RMS of the runs about their mean, passive and active, (2, 3), rad."""
        return np.stack([found.statistics.std for found in (self.measured.passive, self.measured.active)])

    @property
    def rejection(self) -> Array:
        """What the isolator takes away of :attr:`rms`, (3,), percent."""
        return rejection_percent(*self.rms)


def compute_results(p: Parameters, measured: Measurement, step_s: float, seed: int) -> dict[str, OrientationResult]:
    """Compute the closed forms for runs with a communication step (s) and a seed of the disturbance."""
    focal_length = p.optics.focal_length
    density = psd_at_origin(p.noise.wrench_psd_B, p.bus.com_B)
    wrench = multisine_lines(density, measured.band, seed, measured.period_s)
    found = {}
    for name, comparison in measured.comparisons.items():
        bare = loop_at(p, np.radians(ORIENTATIONS[name]))
        loop = bare.with_delay(LOOP_DELAY * step_s)
        earlier, later = (
            jitter_of_lines(bare.with_delay(steps * step_s), *wrench, focal_length, active=True).rms for steps in (1, 2)
        )
        # The RMS is nearly linear in so short a delay.
        fitted = 1.0 + float(np.mean((comparison.active.statistics.std - earlier) / (later - earlier)))
        found[name] = OrientationResult(
            name,
            theory=closed_form(name),
            delayed=jitter(loop, p.bus, p.noise, focal_length, active=True),
            lines=(
                jitter_of_lines(loop, *wrench, focal_length, active=False),
                jitter_of_lines(loop, *wrench, focal_length, active=True),
            ),
            fitted_delay=fitted,
            measured=comparison,
        )
    return found


def nominal_densities(p: Parameters, step_s: float) -> list[tuple[Array, Array]]:
    """Frequency (n,), Hz, and spectral density (n, 3, 3), rad2/Hz, at (0, 0, 0), passive and active with the delay."""
    loop = loop_at(p, delay=LOOP_DELAY * step_s)
    return [jitter_density(loop, p.bus, p.noise, active=active) for active in (False, True)]


def shares(frequency: Array, density: Array) -> Array:
    """Shares of the variance in the bands between :data:`EDGES`, (bands, 3), percent."""
    below = compute_rms_below(frequency, density) ** 2
    at_edges = np.stack([np.interp(EDGES, frequency, column) for column in below.T], axis=-1)
    return np.asarray(100.0 * np.diff(at_edges, axis=0) / below[-1])


def compute_rms_below(frequency: Array, density: Array) -> Array:
    """RMS of everything below each frequency, (n, 3), rad, from a density (n, 3, 3), rad2/Hz."""
    diagonal = np.diagonal(density, axis1=1, axis2=2)
    return np.asarray(np.sqrt(cumulative_trapezoid(diagonal, frequency, axis=0, initial=0.0)))


def deviation_percent(result: OrientationResult) -> Array:
    """Runs against the closed form for the lines, (2, 3), percent."""
    return np.asarray(100.0 * (result.rms / np.stack([found.rms for found in result.lines]) - 1.0))
