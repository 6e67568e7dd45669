"""Table 2 of the paper from the running system: four orientations, passive and active.

The disturbance is the deterministic multisine: lines of fixed amplitude whose phases keep the uncorrelated inputs
apart, so that one period has the RMS of the power spectral density without statistical scatter.  The statistics
cover the duration of the options, one period or several; a lead-in comes before, while the disturbance rises and what
that shakes dies away.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from ....interface.parameter_sets import list_departures
from ....mechanism.parameters import Array
from ....results.figures import draw_table
from ....results.report import Picture
from ....results.tables import Table, format_number
from ....runs.publish import Findings
from ....runs.run import Run
from ....runs.setup import MULTISINE, RunSystem
from ....scenarios.comparison import (
    CASES,
    HEADER,
    Comparison,
    compare,
    explain_refusal,
    make_rows,
)
from ....scenarios.exploration import explore_comparisons
from ...published import published_numbers
from .closed_form import ORIENTATIONS, published_value, rejection, second_axis_text

Triple = tuple[float, float, float]

PERIOD = "disturbance.noise.period"
NOMINAL = "nominal"
USUAL_PERIOD_S = 100.0  # lines from 0.105 Hz on, each 0.01 Hz
SETTLING_S = 10.0  # after the rise: 4.5 time constants of the fine legs' suspension, 2.2 s with the isolator
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 20.0, 1000.0  # two cycles of 0.1 Hz; the memory of the disturbance source

HOW = (
    "Co-simulation of the four FMUs. The disturbance is deterministic: spectral lines of fixed amplitude, whose RMS "
    "over a period has no scatter. Published: Table 2 of the paper. Identified: linear theory with the parameter set "
    "that was identified from the paper, with analogue filters and without the delay of a communication step."
)


@dataclass(frozen=True, eq=False)
class Measurement:
    """The four orientations, passive and active, in the order of :data:`ORIENTATIONS`."""

    system: RunSystem
    comparisons: Mapping[str, Comparison]
    start_s: float
    """Start of the statistics."""
    duration_s: float
    """Their length."""

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
            system,
            options,
            np.radians(target_deg),
            lead_steps=lead_steps,
            prefix=_prefix(target_deg),
            explored=explored and name == NOMINAL,
        )
        for name, target_deg in ORIENTATIONS.items()
    }
    return Measurement(system, found, lead_steps * options.step_s, options.duration_s)


def find(run: Run) -> Findings:
    """Run the four orientations; their jitter beside Table 2."""
    measured = measure(run, explored=True)
    found = measured.comparisons
    rows_of_all = [row for name, comparison in found.items() for row in _rows(name, comparison)]
    table = Table("Jitter of the payload against Table 2", _header(), rows_of_all)
    refused = [explain_refusal(comparison.target_deg) for comparison in found.values() if not comparison.reachable]
    second_axis = describe_second_axis(measured.system, found)
    remarks = [_window_text(measured), _drift_text(found.values()), second_axis, *published_remarks()]
    text = [HOW, *refused, *remarks]

    def draw(folder: Path) -> list[Picture]:
        path = folder / "table2.png"
        draw_table(path, table.header, table.rows, title="Table 2: published and co-simulated")
        return [Picture(path, "Published and co-simulated values.")]

    nominal = found[NOMINAL]
    return Findings(
        title="Table 2: four orientations, passive and active",
        printed="\n".join([table.to_text(), *text[1:]]),
        text=text,
        tables=[table],
        outcomes=[outcome for comparison in found.values() for outcome in comparison.outcomes],
        orientation_deg=nominal.orientation_deg,
        rms_passive_rad=nominal.rms_passive.tolist(),
        rms_active_rad=nominal.rms_active.tolist(),
        rejection_percent=nominal.rejection.tolist(),
        more={
            "statistics_from_s": measured.start_s,
            "statistics_to_s": measured.start_s + measured.duration_s,
            "orientations": [_entry(name, comparison) for name, comparison in found.items()],
        },
        draw=draw,
        explore=partial(explore_comparisons, {_prefix(c.target_deg): c for c in found.values()}, measured.system),
        refused="\n".join(refused),
    )


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return tuple(_prefix(target_deg) + name for target_deg in ORIENTATIONS.values() for name in CASES)


def published_remarks() -> list[str]:
    """What is to be said of single numbers of Table 2."""
    return [
        f"Published {entry.what}: {entry.text} {entry.unit}; {entry.remark}."
        for key, entry in published_numbers().items()
        if key.startswith("table2.") and entry.remark
    ]


def period_s(duration_s: float) -> float:
    """Period of the disturbance [s]: the duration, or the largest part of it that the disturbance source takes."""
    period = duration_s / math.ceil(duration_s / LONGEST_PERIOD_S)
    return period if period >= SHORTEST_PERIOD_S else USUAL_PERIOD_S


def describe_second_axis(system: RunSystem, found: Mapping[str, Comparison]) -> str:
    """How far the second axis is off; or, where parameter files make another system, that it is another one."""
    given = {name: entry.value for name, entry in system.given.items()}
    if others := list_departures(given):
        return (
            f"Parameter files set {others[0]}{f' and {len(others) - 1} more' if others[1:] else ''}: the runs are of "
            "that system; the columns 'published' and 'identified', and what differs from them, are of the paper's."
        )
    return second_axis_text({name: comparison.rms_active for name, comparison in found.items()})


def _window_text(measured: Measurement) -> str:
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


def _drift_text(found: Iterable[Comparison]) -> str:
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


def _prefix(orientation: Triple) -> str:
    return "roll{:g}_pitch{:g}_yaw{:g}_".format(*orientation)


def _header() -> tuple[str, ...]:
    orientation, axis, passive, active, rejection = HEADER
    return (
        orientation, axis, passive, "published", "difference (%)", active, "published", rejection, "published",
        "identified", "difference",
    )  # fmt: skip


def _rows(name: str, comparison: Comparison) -> list[tuple[str, ...]]:
    said = {what: published_value(name, what) for what in ("passive", "active", "rejection")}
    off, points = _differences(name, comparison)
    identified = rejection(name)
    return [
        (
            *row[:3],
            f"{said['passive'][i]:.2e}",
            f"{off[i]:+.1f}",
            row[3],
            f"{said['active'][i]:.2e}",
            row[4],
            f"{said['rejection'][i]:.1f}",
            f"{identified[i]:.2f}",
            format_number(points[i], "+.2f"),
        )
        for i, row in enumerate(make_rows(comparison))
    ]


def _differences(name: str, comparison: Comparison) -> tuple[Array, Array]:
    """Passive RMS against Table 2 (percent), rejection against that of the identified set (points)."""
    off = 100.0 * (comparison.rms_passive / published_value(name, "passive") - 1.0)
    return off, comparison.rejection - rejection(name)


def _entry(name: str, comparison: Comparison) -> dict[str, object]:
    off, points = _differences(name, comparison)
    return {
        "orientation_deg": comparison.orientation_deg,
        "rms_passive_rad": comparison.rms_passive,
        "rms_active_rad": comparison.rms_active,
        "rejection_percent": comparison.rejection,
        **comparison.entry,
        "published_rms_passive_rad": published_value(name, "passive"),
        "published_rms_active_rad": published_value(name, "active"),
        "published_rejection_percent": published_value(name, "rejection"),
        "identified_rejection_percent": rejection(name),
        "passive_against_published_percent": off,
        "rejection_against_identified_points": points,
    }
