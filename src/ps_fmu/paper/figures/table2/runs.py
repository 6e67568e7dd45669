"""Table 2 of the paper from the running system: four orientations, passive and active.

The disturbance is the deterministic multisine: lines of fixed amplitude whose phases keep the uncorrelated inputs
apart, so that one period has the RMS of the power spectral density without statistical scatter.  The statistics
cover the duration of the options, one period or several; a lead-in comes before, while the disturbance rises and what
that shakes dies away.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ....disturbance import multisine_lines, psd_at_origin
from ....mechanism.parameters import Array, Parameters, load
from ....pointing.spectra import rejection_percent
from ....results.tables import format_number
from ....runs.run import Run
from ....runs.system import MULTISINE, RunSystem
from ....scenarios.comparison import CASES, Comparison, compare, run_cases
from ....theory.loop import loop_at
from ....theory.sampled import LOOP_DELAY
from ....theory.transmissibility import Jitter, jitter, jitter_density, jitter_of_lines
from ...published import published_numbers

Triple = tuple[float, float, float]
PERIOD = "disturbance.noise.period"
NOMINAL = "nominal"
USUAL_PERIOD_S = 100.0  # lines from 0.105 Hz on, each 0.01 Hz
SETTLING_S = 10.0  # after the rise: 4.5 time constants of the fine legs' suspension, 2.2 s with the isolator
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 20.0, 1000.0  # two cycles of 0.1 Hz; the memory of the disturbance source
EDGES = (0.1, 0.2, 2.0, 20.0, 1000.0)  # Hz, of the bands whose shares of the variance are shown


@dataclass(frozen=True, eq=False)
class Measurement:
    """The four orientations, passive and active, in the order of :data:`ORIENTATIONS`."""

    system: RunSystem
    comparisons: Mapping[str, Comparison]
    start_s: float  # start of the statistics
    duration_s: float  # their length

    @property
    def period_s(self) -> float:
        """Period of the disturbance."""
        return self.system.get_number(PERIOD)

    @property
    def band(self) -> Array:
        """Band of the disturbance, (2,), Hz."""
        return np.array([self.system.get_number(f"disturbance.noise.band.{end}") for end in ("min", "max")])


def measure(run: Run, *, explored: bool = False) -> Measurement:
    """Run the four orientations, each passive and active; the runs are stored in results.nc.

    ``explored``: keep what a report to explore shows of the nominal one; of all, it would be 6 MB.
    """
    options = run.options
    settings = {MULTISINE: True, PERIOD: period_s(options.duration_s)}
    system = run.load(settings)
    lead_s = system.get_number("disturbance.rise_time") + SETTLING_S
    lead_steps = math.ceil(lead_s / options.step_s - 1e-6)
    found = {
        name: compare(
            target,
            run_cases(
                system,
                options,
                target,
                lead_steps=lead_steps,
                prefix=name_orientation(target_deg),
                explored=explored and name == NOMINAL,
            ),
        )
        for name, target_deg in ORIENTATIONS.items()
        for target in (np.radians(target_deg),)
    }
    return Measurement(system, found, lead_steps * options.step_s, options.duration_s)


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return tuple(name_orientation(target_deg) + name for target_deg in ORIENTATIONS.values() for name in CASES)


def period_s(duration_s: float) -> float:
    """Period of the disturbance [s]: the duration, or the largest part of it that the disturbance source takes."""
    period = duration_s / math.ceil(duration_s / LONGEST_PERIOD_S)
    return period if period >= SHORTEST_PERIOD_S else USUAL_PERIOD_S


def name_orientation(orientation: Triple) -> str:
    """What the names of runs and pictures of an orientation (deg) begin with."""
    return "roll{:g}_pitch{:g}_yaw{:g}_".format(*orientation)


def describe_window(measured: Measurement) -> str:
    """When the statistics were taken, and whether in whole periods: a sentence or two."""
    first, period = measured.start_s, measured.period_s
    text = (
        f"Statistics from {first:g} s, when the disturbance has risen and what that shook has settled, to "
        f"{first + measured.duration_s:g} s"
    )
    periods = measured.duration_s / period
    if periods > 0.5 and abs(periods - round(periods)) < 1e-9:
        coarse = (
            f" In periods below {USUAL_PERIOD_S:g} s few lines lie at the lowest frequencies, where the motion is: the "
            "values are not those of Table 2."
        )
        return f"{text}: {round(periods)} of its periods.{coarse if period < USUAL_PERIOD_S else ''}"
    return f"{text}: not a whole number of its periods of {period:g} s, so the values are not those of Table 2."


def describe_drift(found: Iterable[Comparison]) -> str:
    """The largest difference between the halves of the window, over the RMS."""
    ratios = [
        np.abs(jitter.drift) / np.where(jitter.statistics.rms > 0.0, jitter.statistics.rms, np.nan)
        for comparison in found
        for jitter in (comparison.passive, comparison.active)
    ]
    largest = format_number(100.0 * float(np.max(ratios)), ".2f")
    return (
        "Drift: the weighted means over the second and the first half of the window differ by "
        f"{largest} % of the RMS at most (any axis, orientation, passive or active)."
    )


@dataclass(frozen=True, eq=False)
class OrientationResult:
    """One orientation.  Lists of two: passive, active."""

    name: str
    theory: tuple[Jitter, Jitter]  # closed form from the density, without the delay of the communication step
    delayed: Jitter  # the active one with the delay
    lines: tuple[Jitter, Jitter]  # closed form for the lines that the disturbance has in the runs, with the delay
    fitted_delay: float  # the delay, in steps, at which the closed form for the lines comes closest to the active runs
    measured: Comparison  # as co-simulated

    @property
    def rms(self) -> Array:
        """RMS of the runs about their mean, passive and active, (2, 3), rad."""
        return np.stack([found.statistics.std for found in (self.measured.passive, self.measured.active)])

    @property
    def rejection(self) -> Array:
        """What the isolator takes away of :attr:`rms`, (3,), percent."""
        return rejection_percent(*self.rms)

    @property
    def entry(self) -> dict[str, object]:
        """For the JSON file."""
        return {
            "orientation_deg": ORIENTATIONS[self.name],
            "closed_form_passive_rad": self.theory[0].rms,
            "closed_form_active_rad": self.theory[1].rms,
            "closed_form_active_with_delay_rad": self.delayed.rms,
            "closed_form_of_lines_passive_rad": self.lines[0].rms,
            "closed_form_of_lines_active_rad": self.lines[1].rms,
            "cosimulated_passive_rad": self.rms[0],
            "cosimulated_active_rad": self.rms[1],
            "fitted_delay_steps": self.fitted_delay,
            "image_hull_area_passive_m2": self.measured.passive.scatter.hull_area,
            "image_hull_area_active_m2": self.measured.active.scatter.hull_area,
            **self.measured.entry,
        }


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


def deviation_percent(result: OrientationResult) -> Array:
    """Runs against the closed form for the lines, (2, 3), percent."""
    return np.asarray(100.0 * (result.rms / np.stack([found.rms for found in result.lines]) - 1.0))


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


# --- In closed form: analogue filters, no delay of a communication step, a spectral density --------------------------

#: Orientations of Table 2 (deg) by their names in published.csv.
ORIENTATIONS: dict[str, tuple[float, float, float]] = {
    "nominal": (0.0, 0.0, 0.0),
    "roll": (8.5, 0.0, 0.0),
    "pitch": (0.0, -7.0, 0.0),
    "yaw": (0.0, 0.0, 14.0),
}


@cache
def closed_form(name: str, knows_the_payload: bool = False) -> tuple[Jitter, Jitter]:
    """Passive and active jitter at an orientation of :data:`ORIENTATIONS`; half a second.

    ``knows_the_payload``: with an isolator that has the true centre of mass of the payload, not the identified error.
    """
    p = load()
    if knows_the_payload:
        p = replace(p, known_com_P=p.payload.com_P)
    loop = loop_at(p, np.radians(ORIENTATIONS[name]))
    passive, active = (jitter(loop, p.bus, p.noise, p.optics.focal_length, active=on) for on in (False, True))
    return passive, active


def rejection(name: str, knows_the_payload: bool = False) -> Array:
    """What the isolator takes away of the RMS by theory, (3,), percent."""
    passive, active = closed_form(name, knows_the_payload)
    return rejection_percent(passive.rms, active.rms)


def published_value(name: str, what: str) -> Array:
    """Values of Table 2 at an orientation, (3,): ``passive`` or ``active`` RMS (rad), or ``rejection`` (%)."""
    return np.array([published_numbers()[f"table2.{name}_{what}_{axis}"].value for axis in (1, 2, 3)])


def second_axis_text(measured: Mapping[str, Array]) -> str:
    """A paragraph: how far the active RMS of the second axis is from the published one.

    ``measured``: active RMS of runs with the identified parameter set at each orientation, (3,), rad.
    """

    def factors(values: Mapping[str, Array]) -> str:
        return ", ".join(f"{rms[1] / published_value(name, 'active')[1]:.2f}" for name, rms in values.items())

    theory = {name: closed_form(name)[1].rms for name in measured}
    return (
        f"The active RMS of the second axis is not reproduced: our value over the published one is {factors(theory)} "
        f"in closed form and {factors(measured)} co-simulated at the orientations in the order of Table 2. It depends "
        "on details that the paper does not give. Nothing was tuned to it."
    )


def knowledge_text() -> str:
    """A paragraph: the isolator's error in the payload's centre of mass, and what it costs."""
    p = load()
    error = 1e3 * (p.known_com_P - p.payload.com_P)  # mm, axes of P
    cost, perfect = (", ".join(f"{value:.2f}" for value in rejection("nominal", knows)) for knows in (False, True))
    return (
        "The isolator knows the payload's centre of mass with an error, which was identified from Table 2: "
        f"({', '.join(f'{value:+.2f}' for value in error)}) mm in axes of P, {np.linalg.norm(error):.1f} mm in all. "
        f"With this error the rejection at (0, 0, 0) is {cost} % in closed form (published: "
        f"{', '.join(f'{value:g}' for value in published_value('nominal', 'rejection'))} %); with the true centre of "
        f"mass it would be {perfect} %."
    )
