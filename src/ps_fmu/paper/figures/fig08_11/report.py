"""Figs 8 and 11: from base motion to payload rotation, in closed form, and as measured on the running FMUs."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ....analyses.result import AnalysisResult, Finding, paint_pictures, tabulate
from ....analyses.table import AnalysisOptions
from ....mechanism.parameters import Array, load
from ....results.style import ACTIVE, PASSIVE, REFERENCE
from ....results.tables import Table, format_angles
from ....theory.transmissibility import singular_values_db
from ...agreement import ALLOWED_DB, ALLOWED_DEG, BAND, COHERENCE, Agreement
from ...bus_cases import CASES, COLOURS, load_case
from ...published import make_finding
from ..table2.runs import ORIENTATIONS
from .measured import (
    FREQUENCY,
    SHAKING,
    SUSPENSION_BELOW,
    Agreements,
    Curves,
    Setup,
    agreement_table,
    compare_setups,
    compare_step_models,
    compute_curves,
    step_table,
    verdict,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


def analyse(options: AnalysisOptions, frequency: Array = FREQUENCY) -> AnalysisResult:
    """Compute the curves at frequencies (n,), Hz, measure them on the FMUs, compare and draw."""
    at_orientations = {name: compute_curves(load(), rpy, frequency) for name, rpy in ORIENTATIONS.items()}
    of_cases = {case: compute_curves(load_case(case), frequency=frequency) for case in CASES}
    measured = compare_setups(options, SHAKING)
    of_step = compare_step_models(measured, SHAKING.step)
    return AnalysisResult(
        name="transmissibility",
        title="Transmissibility: Figs 8 and 11",
        text=paragraphs(measured),
        findings=findings(at_orientations, of_cases, measured),
        tables=tables(at_orientations, of_cases, measured, of_step),
        pictures=paint_pictures(
            options.output,
            "transmissibility",
            (
                "orientations", "Fig 8: singular values at the four orientations.",
                (12.0, 9.0), paint_orientations, at_orientations,
            ),
            (
                "cases",
                "Fig 11: largest singular value, passive, in the four cases, in closed form and as measured on the "
                "FMUs.",
                (12.0, 7.0), paint_cases, of_cases, measured,
            ),
            (
                "measured", "Fig 8 as measured on the running FMUs, in the band that is shaken.",
                (12.0, 9.0), paint_measured, measured,
            ),
            (
                "deviation",
                "Deviation of what was measured from the closed form: the largest of the three singular values.",
                (15.0, 10.0), paint_deviation, measured,
            ),
        ),
        data={
            "orientations": {
                name: {"start_db": c.start, "attenuation_db": c.attenuation, "amplification_db": c.amplification}
                for name, c in at_orientations.items()
            },
            "cases": {case: {"largest_db": float(c.passive.max())} for case, c in of_cases.items()},
            "measured": [
                {"orientation_deg": s.rpy_deg, "case": s.case, "isolator": s.mode, **a.entry}
                for s, a in measured.items()
            ],
            "measured_active_by_closed_form": {name: agreement.entry for name, agreement in of_step.items()},
        },
    )  # fmt: skip


def findings(
    at_orientations: Mapping[str, Curves], of_cases: Mapping[str, Curves], measured: Agreements | None = None
) -> list[Finding]:
    """The published numbers of Figs 8 and 11; with co-simulated values only if they were measured."""
    return [*_fig8_findings(at_orientations, measured or {}), *_fig11_findings(of_cases, measured or {})]


def _fig8_findings(at_orientations: Mapping[str, Curves], measured: Agreements) -> list[Finding]:
    found = at_orientations.values()
    start = attenuation = None
    if measured:
        passive, active = (
            np.array([_measured_db(measured[Setup(name, active=on)])[:, 0] for name in at_orientations])
            for on in (False, True)
        )
        start, attenuation = float(max(passive[:, 0], key=abs)), float((passive - active).max(axis=1).min())
    bands = np.array([c.amplified_band for c in found])
    _, second, third = np.max([c.amplifications for c in found], axis=0)
    return [
        make_finding(
            "fig8.start", max((c.start for c in found), key=abs), start, "farthest from 0 of four orientations"
        ),
        make_finding(
            "fig8.attenuation",
            min(c.attenuation for c in found),
            attenuation,
            "least of the four orientations; co-simulated: with what a communication step costs",
        ),
        make_finding(
            "fig8.amplification",
            max(c.amplification for c in found),
            remark="largest singular value, largest of the four orientations; the second and the third are amplified "
            f"by up to {second:.1f} and {third:.1f} dB, at minima of the passive curves",
        ),
        make_finding(
            "fig8.amplified_from", float(bands[:, 0].min()), remark="largest singular value, lowest of the four"
        ),
        make_finding(
            "fig8.amplified_to", float(bands[:, 1].max()), remark="largest singular value, highest of the four"
        ),
    ]


def _fig11_findings(of_cases: Mapping[str, Curves], measured: Agreements) -> list[Finding]:
    passive = {case: c.passive for case, c in of_cases.items()}
    runs = {setup.case: _measured_db(a) for setup, a in measured.items() if setup == Setup(case=setup.case)}
    frequency = of_cases["OSM"].frequency
    most = _row_farthest_below(passive["LDOSM"], passive["OSM"])
    remark = (
        f"from {passive['OSM'][most, 0]:.1f} to {passive['LDOSM'][most, 0]:.1f} dB; the largest values of the curves "
        f"are {_resonance(frequency, passive['OSM'])[1]:.1f} and {_resonance(frequency, passive['LDOSM'])[1]:.1f} dB"
    )
    lines = measured[Setup()].response.frequency if measured else None
    return [
        *(
            make_finding(
                key, _largest(passive, *cases), _largest(runs, *cases) if runs else None, "of any singular value"
            )
            for key, cases in (("fig11.similar", ("OSM", "LSM")), ("fig11.similar_damped", ("LDOSM", "LDLSM")))
        ),
        make_finding(
            "fig11.attenuation",
            float(frequency[most]),
            None if lines is None else float(lines[_row_farthest_below(runs["LDOSM"], runs["OSM"])]),
            remark,
        ),
    ]


def _measured_db(agreement: Agreement) -> Array:
    """Singular values of what was measured, (lines, 3), dB."""
    return singular_values_db(agreement.response.matrix)


def _largest(curves_of: Mapping[str, Array], one: str, other: str) -> float:
    """Largest difference of two curves, dB."""
    return float(np.abs(curves_of[one] - curves_of[other]).max())


def _row_farthest_below(curve: Array, other: Array) -> int:
    """Row in which the largest singular value of a curve is farthest below that of the other."""
    return int((curve - other)[:, 0].argmin())


def paragraphs(measured: Agreements) -> list[str]:
    """What follows; docs/paper.md says how it is computed and measured."""
    return [
        "The passive curve does not depend on the bus: in Fig 11 OSM and LSM are one curve, as are LDOSM and LDLSM. "
        "More damping in the fine legs takes away the resonance of the suspension, and changes little above it.",
        f"The FMUs, shaken, against the closed form. {verdict(measured)}",
    ]


def tables(
    at_orientations: Mapping[str, Curves],
    of_cases: Mapping[str, Curves],
    measured: Agreements,
    of_step: Mapping[str, Agreement],
) -> list[Table]:
    """All tables."""
    return [
        _orientation_table(at_orientations),
        _case_table(of_cases),
        agreement_table(measured),
        step_table(of_step),
    ]


def _orientation_table(found: Mapping[str, Curves]) -> Table:
    return tabulate(
        "Fig 8, practical plant, largest singular value; published: 0, over 50, under 9 dB",
        found.items(),
        (
            ("orientation (deg)", lambda of: format_angles(ORIENTATIONS[of[0]])),
            ("start (dB)", lambda of: f"{of[1].start:.4f}"),
            ("largest attenuation (dB)", lambda of: f"{of[1].attenuation:.2f}"),
            ("largest amplification, 100-700 Hz (dB)", lambda of: f"{of[1].amplification:.2f}"),
        ),
    )


def _case_table(found: Mapping[str, Curves]) -> Table:
    header = (
        "case", "resonance (Hz)", "there (dB)", "at 20 Hz (dB)",
        "by (38): resonance (Hz)", "there (dB)", "at 20 Hz (dB)",
    )  # fmt: skip
    rows = [
        (case, *(text for curve in (c.passive, c.theory) for text in _resonance_cells(c.frequency, curve)))
        for case, c in found.items()
    ]
    return Table("Fig 11: passive, largest singular value", header, rows)


def _resonance(frequency: Array, curve: Array) -> tuple[float, float]:
    """Frequency, Hz, and largest singular value, dB, at the resonance of the fine legs; ``curve`` (n, 3)."""
    top = int(curve[frequency < SUSPENSION_BELOW, 0].argmax())
    return float(frequency[top]), float(curve[top, 0])


def _resonance_cells(frequency: Array, curve: Array) -> tuple[str, ...]:
    values = (*_resonance(frequency, curve), np.interp(20.0, frequency, curve[:, 0]))
    return tuple(f"{value:.2f}" for value in values)


# --- Figures ----------------------------------------------------------------------------------------------------------

MARKERS = {"OSM": "o", "LSM": "x", "LDOSM": "s", "LDLSM": "+"}
SMALLEST = 1e-8  # of what is shown: below is rounding


def paint_orientations(figure: Figure, found: Mapping[str, Curves]) -> None:
    """Fig 8: all three singular values, passive and active, and the theory (38)."""
    for axes, curves in zip(_make_panels(figure), found.values(), strict=True):
        for values, colour, style, text in (
            (curves.passive, PASSIVE, "-", "passive"),
            (curves.active, ACTIVE, "-", "active"),
            (curves.theory, "black", ":", "passive, theory (38)"),
        ):
            axes.semilogx(curves.frequency, values[:, 0], style, color=colour, linewidth=1.8, label=text)
            axes.semilogx(curves.frequency, values[:, 1:], style, color=colour, linewidth=1.1)
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle("Base motion to payload rotation")


def _make_panels(figure: Figure) -> list[Axes]:
    """Axes for singular values over frequency, one for each orientation, two by two."""
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, rpy_deg in zip(panels.flat, ORIENTATIONS.values(), strict=True):
        axes.set(title=f"{format_angles(rpy_deg)} deg", ylim=(-90.0, 50.0))
    for axes in panels[:, 0]:
        axes.set_ylabel("singular values (dB)")
    for axes in panels[1]:
        axes.set_xlabel("frequency (Hz)")
    return list(panels.flat)


def paint_cases(figure: Figure, found: Mapping[str, Curves], measured: Agreements) -> None:
    """Fig 11: the largest singular value, passive, of the four cases: theory (38) dotted, markers as measured."""
    axes = figure.subplots()
    # The passive curve does not depend on the bus: the second of two equal curves is broken.
    for case, curves in found.items():
        style = (0, (5, 5)) if case.endswith("LSM") else "-"
        axes.semilogx(curves.frequency, curves.passive[:, 0], linestyle=style, color=COLOURS[case], label=case)
        axes.semilogx(curves.frequency, curves.theory[:, 0], ":", color=REFERENCE, linewidth=1.0)
    axes.plot([], [], ":", color=REFERENCE, label="theory (38)")
    for i, case in enumerate(CASES):
        response = measured[Setup(case=case)].response
        some = _thin_out(response.frequency)[i :: len(CASES)]
        values = singular_values_db(response.matrix[some])[:, 0]
        axes.plot(
            response.frequency[some], values, MARKERS[case], color=COLOURS[case], markersize=8.0,
            markerfacecolor="none", markeredgewidth=1.8, label=f"{case}, measured",
        )  # fmt: skip
    axes.set(xlabel="frequency (Hz)", ylabel="largest singular value (dB)")
    axes.legend(ncols=2)
    figure.suptitle("Passive transmissibility")


def paint_measured(figure: Figure, measured: Agreements) -> None:
    """Fig 8 from the running FMUs: all three singular values, passive and active, on those in closed form."""
    panels = _make_panels(figure)
    for axes, name in zip(panels, ORIENTATIONS, strict=True):
        for active, colour in ((False, PASSIVE), (True, ACTIVE)):
            setup = Setup(name, active=active)
            agreement = measured[setup]
            f = agreement.response.frequency
            values = _measured_db(agreement)
            axes.semilogx(f, values[:, 0], ".", color=colour, markersize=6.0, label=f"{setup.mode}, measured")
            axes.semilogx(f, values[:, 1:], ".", color=colour, markersize=6.0)
            axes.semilogx(f, singular_values_db(agreement.reference), color="black", linewidth=0.9)
        axes.plot([], [], color="black", linewidth=0.9, label="closed form")
    _label_band(panels[2:])
    figure.legend(*axes.get_legend_handles_labels(), loc="outside lower center", ncols=3, markerscale=2.0)
    figure.suptitle("Base motion to payload rotation, measured on the running FMUs")


def paint_deviation(figure: Figure, measured: Agreements) -> None:
    """Largest deviation of a singular value from the closed form, in gain and phase, and one less the coherence.

    Columns: the orientations passive, the same active, the cases of Fig 11.
    """
    columns = {
        f"orientations (deg), {mode}": {
            format_angles(ORIENTATIONS[name]): (measured[Setup(name, active=active)], colour)
            for name, colour in zip(ORIENTATIONS, COLOURS.values(), strict=True)
        }
        for mode, active in (("passive", False), ("active", True))
    }
    columns["cases at (0, 0, 0), passive"] = {case: (measured[Setup(case=case)], COLOURS[case]) for case in CASES}
    rows = {"gain (dB)": ALLOWED_DB, "phase (deg)": ALLOWED_DEG, "1 - coherence": 1.0 - COHERENCE}
    panels = figure.subplots(len(rows), len(columns), sharex=True, sharey="row")
    for column, (title, agreements) in zip(panels.T, columns.items(), strict=True):
        for name, (agreement, colour) in agreements.items():
            shown = (
                np.abs(agreement.deviation_db).max(axis=1),
                np.abs(agreement.deviation_deg).max(axis=1),
                1.0 - agreement.response.coherence.min(axis=1),
            )
            for axes, values in zip(column, shown, strict=True):
                axes.loglog(agreement.response.frequency, values, color=colour, linewidth=1.1, label=name)
        for axes, allowed in zip(column, rows.values(), strict=True):
            axes.axhline(allowed, color=REFERENCE, linestyle="--", linewidth=1.3)
            axes.set_ylim(SMALLEST, 5.0 * allowed)
        column[0].set_title(title)
        column[-1].legend(loc="upper center", bbox_to_anchor=(0.5, -0.25), ncols=2)
    for axes, text in zip(panels[:, 0], rows, strict=True):
        axes.set_ylabel(text)
    _label_band(panels[-1])
    figure.suptitle("FMUs against the closed form: largest deviation of a singular value; dashed: allowed")
    figure.align_ylabels(panels[:, 0])


def _thin_out(frequency: Array) -> NDArray[np.intp]:
    """Indices of up to 20 frequencies to the decade."""
    decades = np.log10(frequency / frequency[0])
    return np.unique(np.searchsorted(decades, np.arange(0.0, decades[-1], 0.05)))


def _label_band(lowest: Iterable[Axes]) -> None:
    for axes in lowest:
        axes.set(xlabel="frequency (Hz)", xlim=BAND)
        axes.set_xticks([0.2, 1, 10, 100], ["0.2", "1", "10", "100"])
