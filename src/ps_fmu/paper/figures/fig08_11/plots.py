"""Pictures of the transmissibility analysis."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ....mechanism.parameters import Array
from ....results.style import ACTIVE, PASSIVE, REFERENCE
from ....results.tables import format_angles
from ....theory.transmissibility import singular_values_db
from ...agreement import ALLOWED_DB, ALLOWED_DEG, BAND, COHERENCE
from ...bus_cases import CASES, COLOURS
from ..table2.closed_form import ORIENTATIONS
from .measured import Agreements, Curves, Setup

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MARKERS = {"OSM": "o", "LSM": "x", "LDOSM": "s", "LDLSM": "+"}
SMALLEST = 1e-8  # of what is shown: below is rounding


def paint_orientations(figure: Figure, found: Mapping[str, Curves]) -> None:
    """Fig 8: all three singular values, passive and active, and the theory (38)."""
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (name, curves) in zip(panels.flat, found.items(), strict=True):
        for values, colour, text in (
            (curves.passive, PASSIVE, "passive"),
            (curves.active, ACTIVE, "active"),
            (curves.theory, "black", "passive, theory (38)"),
        ):
            style = ":" if colour == "black" else "-"
            for i, width in enumerate((1.8, 1.1, 1.1)):
                axes.semilogx(
                    curves.frequency, values[:, i], style, color=colour, linewidth=width,
                    label=text if i == 0 else None,
                )  # fmt: skip
        axes.set(title=f"{format_angles(ORIENTATIONS[name])} deg", ylim=(-90.0, 50.0))
    for axes in panels[:, 0]:
        axes.set_ylabel("singular values (dB)")
    for axes in panels[1]:
        axes.set_xlabel("frequency (Hz)")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
    figure.suptitle("Base motion to payload rotation")


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
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, name in zip(panels.flat, ORIENTATIONS, strict=True):
        for active, colour in ((False, PASSIVE), (True, ACTIVE)):
            setup = Setup(name, active=active)
            agreement = measured[setup]
            f = agreement.response.frequency
            values = singular_values_db(agreement.response.matrix)
            label = f"{setup.mode}, measured"
            axes.semilogx(f, values[:, 0], ".", color=colour, markersize=6.0, label=label)
            axes.semilogx(f, values[:, 1:], ".", color=colour, markersize=6.0)
            axes.semilogx(f, singular_values_db(agreement.reference), color="black", linewidth=0.9)
        axes.plot([], [], color="black", linewidth=0.9, label="closed form")
        axes.set(title=f"{format_angles(ORIENTATIONS[name])} deg", ylim=(-90.0, 50.0))
    _label_band(panels[-1])
    for axes in panels[:, 0]:
        axes.set_ylabel("singular values (dB)")
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=3, markerscale=2.0)
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
