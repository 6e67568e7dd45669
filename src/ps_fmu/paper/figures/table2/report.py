"""Table 2 and Fig 9: jitter as co-simulated beside the paper's, and in closed form."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ....analyses.result import AnalysisResult, Finding, paint_pictures, tabulate
from ....analyses.table import AnalysisOptions
from ....interface.start_values import list_departures
from ....mechanism.parameters import Array, load
from ....results.figures import draw_table
from ....results.report import Picture
from ....results.tables import Table, format_angles, format_number, format_tables
from ....runs.publish import Findings
from ....runs.run import Run
from ....runs.scenario import SCENARIOS, Scenario
from ....runs.system import DISTURBED, RunSystem
from ....scenarios.comparison import HEADER, Comparison, explain_refusal, make_rows
from ....scenarios.comparison import NEEDS as COMPARED
from ....scenarios.exploration import explore_comparisons
from ....theory.sampled import LOOP_DELAY
from ...cosimulation import hold_run
from ...published import make_finding, published_numbers
from . import runs
from .plots import paint_cumulative, paint_image, paint_rms
from .runs import ORIENTATIONS, OrientationResult, list_cases, measure, published_value, rejection

__all__ = ["NEEDS", "analyse", "find", "list_cases"]

NEEDS = (*COMPARED, *DISTURBED)
HOW = (
    "Co-simulation of the four FMUs. The disturbance is deterministic: spectral lines of fixed amplitude, whose RMS "
    "over a period has no scatter. Published: Table 2 of the paper. Identified: linear theory with the parameter set "
    "that was identified from the paper, with analogue filters and without the delay of a communication step."
)
LARGEST_DEVIATION = 10.0  # percent: a value farther from the published one gets a remark


def find(run: Run) -> Findings:
    """Run the four orientations; their jitter beside Table 2."""
    measured = measure(run, explored=True)
    found = measured.comparisons
    table = comparison_table(found)
    refused = [explain_refusal(comparison.target_deg) for comparison in found.values() if not comparison.reachable]
    remarks = [runs.describe_window(measured), runs.describe_drift(found.values())]
    text = [HOW, *refused, *remarks, describe_second_axis(measured.system, found), *published_remarks()]

    def draw(folder: Path) -> list[Picture]:
        path = folder / "table2.png"
        draw_table(path, table.header, table.rows, title="Table 2: published and co-simulated")
        return [Picture(path, "Published and co-simulated values.")]

    nominal = found[runs.NOMINAL]
    return Findings(
        title="Table 2: four orientations, passive and active",
        printed=format_tables([table], text[1:]),
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
            "orientations": [
                {
                    "orientation_deg": comparison.orientation_deg,
                    "rms_passive_rad": comparison.rms_passive,
                    "rms_active_rad": comparison.rms_active,
                    "rejection_percent": comparison.rejection,
                    **comparison.entry,
                    **_set_beside(name, comparison),
                }
                for name, comparison in found.items()
            ],
        },
        draw=draw,
        explore=partial(
            explore_comparisons, {runs.name_orientation(c.target_deg): c for c in found.values()}, measured.system
        ),
        refused="\n".join(refused),
    )


def comparison_table(found: Mapping[str, Comparison]) -> Table:
    """The runs beside Table 2 and the identified parameter set, each axis of each orientation."""
    orientation, axis, passive, active, taken = HEADER
    header = (
        orientation, axis, passive, "published", "difference (%)", active, "published", taken, "published",
        "identified", "difference",
    )  # fmt: skip
    rows = []
    for name, comparison in found.items():
        beside = zip(*_set_beside(name, comparison).values(), strict=True)
        for row, (of_passive, of_active, of_taken, identified, off, points) in zip(
            make_rows(comparison), beside, strict=True
        ):
            rows.append((
                *row[:3], f"{of_passive:.2e}", f"{off:+.1f}", row[3], f"{of_active:.2e}", row[4], f"{of_taken:.1f}",
                f"{identified:.2f}", format_number(points, "+.2f"),
            ))  # fmt: skip
    return Table("Jitter of the payload against Table 2", header, rows)


def _set_beside(name: str, comparison: Comparison) -> dict[str, Array]:
    """What stands beside the runs at an orientation, by its keys in the JSON file, (3,) each."""
    passive, active, taken = (published_value(name, what) for what in ("passive", "active", "rejection"))
    return {
        "published_rms_passive_rad": passive,
        "published_rms_active_rad": active,
        "published_rejection_percent": taken,
        "identified_rejection_percent": rejection(name),
        "passive_against_published_percent": 100.0 * (comparison.rms_passive / passive - 1.0),
        "rejection_against_identified_points": comparison.rejection - rejection(name),
    }


def published_remarks() -> list[str]:
    """What is to be said of single numbers of Table 2."""
    return [
        f"Published {entry.what}: {entry.text} {entry.unit}; {entry.remark}."
        for key, entry in published_numbers().items()
        if key.startswith("table2.") and entry.remark
    ]


def describe_second_axis(system: RunSystem, found: Mapping[str, Comparison]) -> str:
    """How far the second axis is off; or, where parameter files make another system, that it is another one."""
    given = {name: entry.value for name, entry in system.given.items()}
    if others := list_departures(given):
        return (
            f"Parameter files set {others[0]}{f' and {len(others) - 1} more' if others[1:] else ''}: the runs are of "
            "that system; the columns 'published' and 'identified', and what differs from them, are of the paper's."
        )
    return runs.second_axis_text({name: comparison.rms_active for name, comparison in found.items()})


def analyse(options: AnalysisOptions, scenario: Scenario = SCENARIOS["table2"]) -> AnalysisResult:
    """Run the co-simulation, compute the closed forms, compare and draw."""
    with hold_run(options, scenario) as run:
        measured = measure(run)
    parameters = load()
    results = runs.compute_results(parameters, measured, run.options.step_s, options.seed)
    densities = runs.nominal_densities(parameters, run.options.step_s)
    return AnalysisResult(
        name="jitter",
        title="Jitter: Table 2 and Fig 9",
        text=paragraphs(results, densities),
        findings=findings(results),
        tables=tables(results, densities),
        pictures=paint_pictures(
            options.output,
            "jitter",
            (
                "image",
                "Fig 9: co-simulated image points with hull; ellipses of the closed form, active with "
                f"{LOOP_DELAY:g} steps of delay.",
                (15.0, 9.0), paint_image, results,
            ),
            (
                "rms",
                "Table 2: RMS as published, in closed form without the delay of the communication step, and "
                "co-simulated.",
                (13.0, 8.5), paint_rms, results,
            ),
            (
                "cumulative",
                f"RMS of everything below a frequency, closed form with {LOOP_DELAY:g} steps of delay, at (0, 0, 0).",
                (12.0, 5.5), paint_cumulative, densities,
            ),
        ),
        data={"loop_delay_steps": LOOP_DELAY, "orientations": {r.name: r.entry for r in results.values()}},
    )  # fmt: skip


def findings(results: Mapping[str, OrientationResult]) -> list[Finding]:
    """Table 2, Fig 9 at the nominal orientation, and the claim on the rejection."""
    found = []
    for name, result in results.items():
        passive, active = result.rms
        for i in range(3):
            for what, computed, cosimulated in (
                ("passive", result.theory[0].rms, passive),
                ("active", result.theory[1].rms, active),
                ("rejection", rejection(name), result.rejection),
            ):
                values = float(computed[i]), float(cosimulated[i])
                remark = _remark(published_value(name, what)[i], *values, second_axis=i == 1)
                found.append(make_finding(f"table2.{name}_{what}_{i + 1}", *values, remark))
    nominal = results["nominal"]
    for what, theory, jitter_found in zip(
        ("passive", "active"), nominal.theory, (nominal.measured.passive, nominal.measured.active), strict=True
    ):
        remark = "RMS distance from the mean at (0, 0, 0)"
        found.append(make_finding(f"fig9.radius_{what}", theory.radius_rms, jitter_found.scatter.radius_rms, remark))
    least = [
        min(float(values.min()) for values in rejections)
        for rejections in zip(*((rejection(name), r.rejection) for name, r in results.items()), strict=True)
    ]
    found.append(make_finding("text.rejection", least[0], least[1], "of any axis at the four orientations"))
    for k, what in enumerate(("passive", "active")):
        largest = max(float(r.theory[k].rms.max()) for r in results.values())
        of_runs = max(float(r.rms[k].max()) for r in results.values())
        remark = "largest RMS of any axis at the four orientations"
        found.append(make_finding(f"text.jitter_{what}", largest, of_runs, remark))
    return found


def _remark(said: float, computed: float, cosimulated: float, *, second_axis: bool) -> str:
    """The remark on a value that is far from that of Table 2."""
    off = [100.0 * (ours / said - 1.0) for ours in (computed, cosimulated)]
    if max(map(abs, off)) <= LARGEST_DEVIATION:
        return ""
    by = f"{off[0]:+.0f} % in closed form, {off[1]:+.0f} % co-simulated"
    if second_axis:
        return f"not reproduced: {by}; depends on unpublished details"
    return f"{by}: what is left of the 5 Hz resonance depends on unpublished details; the runs add 1.5 steps of delay"


def tables(results: Mapping[str, OrientationResult], densities: list[tuple[Array, Array]]) -> list[Table]:
    """All tables."""
    return [
        _rms_table(results),
        _knowledge_table(),
        _agreement_table(results),
        _image_table(results),
        _share_table(densities),
    ]


class _Place(NamedTuple):
    """An axis of an orientation: a row of a table."""

    of: OrientationResult
    axis: int  # from 0

    def said(self, what: str) -> float:
        """The published value."""
        return float(published_value(self.of.name, what)[self.axis])


def _each_axis(results: Mapping[str, OrientationResult]) -> list[_Place]:
    return [_Place(result, axis) for result in results.values() for axis in range(3)]


PLACE: tuple[tuple[str, Callable[[_Place], str]], ...] = (
    ("orientation (deg)", lambda at: "" if at.axis else format_angles(ORIENTATIONS[at.of.name])),
    ("axis", lambda at: f"{at.axis + 1}"),
)


def _rms_table(results: Mapping[str, OrientationResult]) -> Table:
    """Table 2: published, in closed form and co-simulated, each axis of each orientation."""
    return tabulate(
        "Table 2; closed form without the delay of the communication step",
        _each_axis(results),
        (
            *PLACE,
            ("passive RMS (rad): published", lambda at: f"{at.said('passive'):.3e}"),
            ("closed form", lambda at: f"{at.of.theory[0].rms[at.axis]:.3e}"),
            ("co-simulated", lambda at: f"{at.of.rms[0, at.axis]:.3e}"),
            ("active RMS (rad): published", lambda at: f"{at.said('active'):.3e}"),
            ("closed form", lambda at: f"{at.of.theory[1].rms[at.axis]:.3e}"),
            ("co-simulated", lambda at: f"{at.of.rms[1, at.axis]:.3e}"),
            ("rejection (%): published", lambda at: f"{at.said('rejection'):.1f}"),
            ("closed form", lambda at: f"{rejection(at.of.name)[at.axis]:.2f}"),
            ("co-simulated", lambda at: f"{at.of.rejection[at.axis]:.2f}"),
        ),
    )


def _knowledge_table() -> Table:
    """What the error in the isolator's knowledge of the payload costs or brings, at (0, 0, 0)."""
    header = (
        "centre of mass that the isolator knows",
        "active RMS (rad): axis 1", "2", "3", "rejection (%): axis 1", "2", "3",
    )  # fmt: skip
    rows = [
        (
            name,
            *(f"{value:.3e}" for value in runs.closed_form("nominal", knows)[1].rms),
            *(f"{value:.2f}" for value in rejection("nominal", knows)),
        )
        for name, knows in (("as identified", False), ("true", True))
    ]
    return Table("What the isolator knows of the payload, at (0, 0, 0), closed form", header, rows)


def _agreement_table(results: Mapping[str, OrientationResult]) -> Table:
    """The runs beside the closed form with the delay of the communication step."""
    return tabulate(
        f"Closed form with {LOOP_DELAY:g} steps of delay, and co-simulation",
        _each_axis(results),
        (
            *PLACE,
            ("passive RMS (rad): from the lines", lambda at: f"{at.of.lines[0].rms[at.axis]:.4e}"),
            ("co-simulated", lambda at: f"{at.of.rms[0, at.axis]:.4e}"),
            ("difference (%)", lambda at: f"{runs.deviation_percent(at.of)[0, at.axis]:+.2f}"),
            ("active RMS (rad): from the density", lambda at: f"{at.of.delayed.rms[at.axis]:.4e}"),
            ("from the lines", lambda at: f"{at.of.lines[1].rms[at.axis]:.4e}"),
            ("co-simulated", lambda at: f"{at.of.rms[1, at.axis]:.4e}"),
            ("difference (%)", lambda at: f"{runs.deviation_percent(at.of)[1, at.axis]:+.2f}"),
        ),
    )


def _image_table(results: Mapping[str, OrientationResult]) -> Table:
    """Fig 9: radii and area of the scatter of the image point."""
    header = (
        "orientation (deg)", "case", "RMS radius, closed form (m)", "co-simulated (m)", "largest radius (m)",
        "area of the hull (m2)",
    )  # fmt: skip
    rows = []
    for r in results.values():
        for name, case, theory, run in (
            (format_angles(ORIENTATIONS[r.name]), "passive", r.theory[0], r.measured.passive),
            ("", "active", r.delayed, r.measured.active),
        ):
            sizes = theory.radius_rms, run.scatter.radius_rms, run.scatter.radius_max, run.scatter.hull_area
            rows.append((name, case, *(f"{size:.3e}" for size in sizes)))
    return Table("Scatter of the image point: Fig 9", header, rows)


def _share_table(densities: list[tuple[Array, Array]]) -> Table:
    """Shares of the variance by band; ``densities``: frequency and density, passive and active."""
    header = ("band (Hz)", *(f"{case} {axis}" for case in ("passive", "active") for axis in (1, 2, 3)))
    found = np.concatenate([runs.shares(*density) for density in densities], axis=1)
    rows = [
        (f"{low:g} to {high:g}", *(f"{value:.2f}" for value in row))
        for low, high, row in zip(runs.EDGES[:-1], runs.EDGES[1:], found, strict=True)
    ]
    caption = (
        f"Share of the variance by frequency at (0, 0, 0), percent; closed form with {LOOP_DELAY:g} steps of delay"
    )
    return Table(caption, header, rows)


def paragraphs(results: Mapping[str, OrientationResult], densities: list[tuple[Array, Array]]) -> list[str]:
    """What follows; docs/paper.md says how it is computed."""
    worst = [float(np.abs(runs.deviation_percent(r)).max(axis=1)[k]) for k in (0, 1) for r in results.values()]
    half = len(results)
    fitted = [r.fitted_delay for r in results.values()]
    passive, active = (runs.shares(*density) for density in densities)
    others = 100.0 * np.array(
        [r.rms[1, [0, 2]] / published_value(r.name, "active")[[0, 2]] - 1.0 for r in results.values()]
    )
    means = max(float(np.abs(r.measured.active.statistics.mean).max()) for r in results.values())
    farthest = list(results.values())[int(np.abs(others).max(axis=1).argmax())].name
    return [
        "From the closed form for the spectral lines of their disturbance the runs differ by at most "
        f"{max(worst[:half]):.2f} % passive, {max(worst[half:]):.2f} % active.",
        f"The RMS of the runs is about their mean. With the isolator the mean is up to {1e9 * means:.0f} nrad: its "
        "high-pass starts at rest, and what that leaves dies away in tens of minutes.",
        f"The closed form for comparison has a delay of {LOOP_DELAY:g} communication steps in the loop: the exchange "
        "takes one, and a force that is held for a step is late by half a step. It comes closest to the runs with "
        f"{min(fitted):.2f} to {max(fitted):.2f} steps.",
        f"Sources of the jitter at (0, 0, 0): {passive[0].min():.0f} to {passive[0].max():.0f} % of the passive "
        f"variance lie below 0.2 Hz, the rigid motion of the bus; {active[2].min():.0f} to {active[2].max():.0f} % of "
        "the active variance lie between 2 and 20 Hz: the resonance of the fine legs, and the delay of the low-pass "
        "M(s) there.",
        runs.knowledge_text(),
        runs.second_axis_text({r.name: r.rms[1] for r in results.values()}),
        "On the other axes the active RMS of the runs differs from the published one by "
        f"{others.min():+.0f} to {others.max():+.0f} %, most at {format_angles(ORIENTATIONS[farthest])} deg.",
        *published_remarks(),
    ]
