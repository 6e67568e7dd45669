"""Table 2 of the paper from the running system: four orientations, passive and active.

The disturbance is the deterministic multisine: lines of fixed amplitude whose phases keep the uncorrelated inputs
apart, so that one period has the RMS of the power spectral density without statistical scatter.  The statistics
cover the duration of the options, one period or several; a lead-in while the disturbance rises comes before.
"""

from __future__ import annotations

import math

import numpy as np

from ..cosim import System
from ..pointing import plots
from ..pointing.report import Picture, Table
from .comparison import HEADER, Comparison, compare, draw, rows
from .options import RunOptions
from .publish import Findings, publish, text_table
from .setup import load_system, real_start

Triple = tuple[float, float, float]

#: Orientation (deg): published passive RMS (rad), published rejection (%), rejection of the identified set (%).
PUBLISHED: dict[Triple, tuple[Triple, Triple, Triple]] = {
    (0.0, 0.0, 0.0): ((1.65e-5, 5.02e-6, 5.34e-6), (99.3, 99.6, 97.7), (99.36, 99.17, 97.85)),
    (8.5, 0.0, 0.0): ((1.65e-5, 5.03e-6, 5.62e-6), (99.5, 99.3, 97.4), (99.48, 98.94, 97.36)),
    (0.0, -7.0, 0.0): ((1.65e-5, 5.02e-6, 5.68e-6), (99.7, 96.9, 97.8), (99.51, 98.53, 97.48)),
    (0.0, 0.0, 14.0): ((1.64e-5, 5.63e-6, 5.37e-6), (99.4, 96.9, 98.9), (99.35, 98.50, 98.90)),
}
PERIOD = "disturbance.noise.period"
USUAL_PERIOD_S = 100.0  # lines from 0.105 Hz on, each 0.01 Hz
SHORTEST_PERIOD_S, LONGEST_PERIOD_S = 20.0, 1000.0  # two cycles of 0.1 Hz; the memory of the disturbance source

HOW = (
    "Co-simulation of the four FMUs. The disturbance is deterministic: spectral lines of fixed amplitude, whose RMS "
    "over a period has no scatter. Published: Table 2 of the paper. Identified: linear theory with the parameter set "
    "that was identified from the paper, with analogue filters and without the delay of a communication step."
)
SECOND_AXIS = (
    "The active RMS of the second axis is not that of the paper (factors 2.2, 1.5, 0.5, 0.5): it depends on details "
    "that the paper does not give. Nothing was tuned to it."
)


def run(options: RunOptions) -> None:
    """Run the scenario; writes results.nc, summary.json, figures and report.html, prints the table."""
    settings = {"disturbance.noise.multisine": True, PERIOD: period_s(options.duration_s)}
    system = load_system(options, settings)
    lead_steps = math.ceil(real_start(system, "disturbance.rise_time") / options.step_s - 1e-6)
    found = [
        compare(system, options, orientation, lead_steps=lead_steps, prefix=_prefix(orientation))
        for orientation in PUBLISHED
    ]
    table = Table("Jitter of the payload against Table 2", _header(), [row for c in found for row in _rows(c)])
    text = [HOW, _window(system, options, lead_steps), _drift(found), SECOND_AXIS]
    print(text_table(table.header, table.rows), *text[1:], sep="\n")

    path = options.output / "table2.png"
    plots.table(path, table.header, table.rows, title="Table 2: published and co-simulated")
    pictures = [Picture(path, "Published and co-simulated values.")]
    for comparison, orientation in zip(found, PUBLISHED, strict=True):
        pictures += draw(comparison, options.output, _prefix(orientation))
    publish(
        options,
        system,
        Findings(
            title="Table 2: four orientations, passive and active",
            text=text,
            tables=[table],
            pictures=pictures,
            outcomes=[outcome for comparison in found for outcome in comparison.outcomes],
            orientation_deg=found[0].orientation_deg,
            rms_passive_rad=found[0].rms_passive.tolist(),
            rms_active_rad=found[0].rms_active.tolist(),
            rejection_percent=found[0].rejection.tolist(),
            more={
                "statistics_from_s": lead_steps * options.step_s,
                "statistics_to_s": lead_steps * options.step_s + options.duration_s,
                "orientations": [_entry(comparison) for comparison in found],
            },
        ),
    )


def period_s(duration_s: float) -> float:
    """Period of the disturbance [s]: the duration, or the largest part of it that the disturbance source takes."""
    period = duration_s / math.ceil(duration_s / LONGEST_PERIOD_S)
    return period if period >= SHORTEST_PERIOD_S else USUAL_PERIOD_S


def _window(system: System, options: RunOptions, lead_steps: int) -> str:
    first = lead_steps * options.step_s
    period = real_start(system, PERIOD)
    text = f"Statistics from {first:g} s, when the disturbance has risen, to {first + options.duration_s:g} s"
    periods = options.duration_s / period
    if periods > 0.5 and abs(periods - round(periods)) < 1e-9:
        coarse = (
            f" In periods below {USUAL_PERIOD_S:g} s few lines lie at the lowest frequencies, where the motion is: the "
            "values are not those of Table 2."
        )
        return f"{text}: {round(periods)} of its periods.{coarse if period < USUAL_PERIOD_S else ''}"
    return f"{text}: not a whole number of its periods of {period:g} s, so the values are not those of Table 2."


def _drift(found: list[Comparison]) -> str:
    """The largest difference between the halves of the window, over the RMS."""
    ratios = [
        np.abs(jitter.drift) / np.where(jitter.statistics.rms > 0.0, jitter.statistics.rms, np.nan)
        for comparison in found
        for jitter in (comparison.passive, comparison.active)
    ]
    return (
        "Drift: the weighted means over the second and the first half of the window differ by "
        f"{100.0 * np.max(ratios):.2f} % of the RMS at most (any axis, orientation, passive or active)."
    )


def _prefix(orientation: Triple) -> str:
    return "roll{:g}_pitch{:g}_yaw{:g}_".format(*orientation)


def _header() -> tuple[str, ...]:
    return (*HEADER[:3], "published", "difference (%)", *HEADER[3:], "published", "identified", "difference")


def _rows(comparison: Comparison) -> list[tuple[str, ...]]:
    passive, rejection, identified = PUBLISHED[comparison.target_deg]
    off, points = _differences(comparison)
    return [
        (
            *row[:3],
            f"{passive[i]:.2e}",
            f"{off[i]:+.1f}",
            *row[3:],
            f"{rejection[i]:.1f}",
            f"{identified[i]:.2f}",
            f"{points[i]:+.2f}",
        )
        for i, row in enumerate(rows(comparison))
    ]


def _differences(comparison: Comparison) -> tuple[np.ndarray, np.ndarray]:
    """Passive RMS against Table 2 (percent), rejection against that of the identified set (points)."""
    passive, _, identified = PUBLISHED[comparison.target_deg]
    return 100.0 * (comparison.rms_passive / np.array(passive) - 1.0), comparison.rejection - np.array(identified)


def _entry(comparison: Comparison) -> dict[str, object]:
    passive, rejection, identified = PUBLISHED[comparison.target_deg]
    off, points = _differences(comparison)
    return {
        "orientation_deg": comparison.orientation_deg,
        "rms_passive_rad": comparison.rms_passive,
        "rms_active_rad": comparison.rms_active,
        "rejection_percent": comparison.rejection,
        **comparison.entry,
        "published_rms_passive_rad": passive,
        "published_rejection_percent": rejection,
        "identified_rejection_percent": identified,
        "passive_against_published_percent": off,
        "rejection_against_identified_points": points,
    }
