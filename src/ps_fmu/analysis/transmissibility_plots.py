"""Figures of the transmissibility analysis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..pointing.style import ACTIVE, AXES, PASSIVE, REFERENCE, draw
from ..scenarios.comparison import angles
from ..scenarios.table2 import ORIENTATIONS
from .agreement import ALLOWED_DB, ALLOWED_DEG, BAND, Agreement
from .stability_plots import COLOURS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from .transmissibility import Curves


def orientations_figure(path: Path, found: Mapping[str, Curves]) -> None:
    """Fig 8: all three singular values, passive and active, and the theory (38)."""
    from .transmissibility import FREQUENCY

    def paint(figure: Figure) -> None:
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
                        FREQUENCY, values[:, i], style, color=colour, linewidth=width,
                        label=text if i == 0 else None,
                    )  # fmt: skip
            axes.set(title=f"{angles(ORIENTATIONS[name])} deg", ylim=(-90.0, 50.0))
        for axes in panels[:, 0]:
            axes.set_ylabel("singular values (dB)")
        for axes in panels[1]:
            axes.set_xlabel("frequency (Hz)")
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=3)
        figure.suptitle("Base motion to payload rotation")

    draw(path, 12.0, 9.0, paint)


def cases_figure(path: Path, found: Mapping[str, Curves]) -> None:
    """Fig 11: the largest singular value, passive, of the four cases; theory (38) dotted."""
    from .transmissibility import FREQUENCY

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        # The passive curve does not depend on the bus: the second of two equal curves is broken.
        for case, curves in found.items():
            style = (0, (5, 5)) if case.endswith("LSM") else "-"
            axes.semilogx(FREQUENCY, curves.passive[:, 0], linestyle=style, color=COLOURS[case], label=case)
            axes.semilogx(FREQUENCY, curves.theory[:, 0], ":", color=REFERENCE, linewidth=1.0)
        axes.plot([], [], ":", color=REFERENCE, label="theory (38)")
        axes.set(xlabel="frequency (Hz)", ylabel="largest singular value (dB)")
        axes.legend()
        figure.suptitle("Passive transmissibility")

    draw(path, 10.0, 6.0, paint)


def measured_figure(path: Path, measured: Mapping[str, Agreement]) -> None:
    """Singular values measured and in closed form, their deviations in gain and phase, and what coherence lacks to one.

    Passive on the left, active on the right.
    """
    cases = {name: measured[name] for name in ("passive", "active")}

    def paint(figure: Figure) -> None:
        panels = figure.subplots(4, 2, sharex=True, height_ratios=(2.2, 1.0, 1.0, 1.0))
        for column, (name, agreement) in zip(panels.T, cases.items(), strict=True):
            column[0].set_title(name)
            _paint_case(column, agreement)
        for axes, text in zip(
            panels[:, 0], ("singular values (dB)", "gain (dB)", "phase (deg)", "1 - coherence"), strict=True
        ):
            axes.set_ylabel(text)
        for axes in panels[-1]:
            axes.set_xlabel("frequency (Hz)")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=4, markerscale=3.0)
        figure.suptitle("Measured on the FMUs, and deviation from the closed form")
        figure.align_ylabels(panels[:, 0])

    draw(path, 12.0, 11.0, paint)


def _paint_case(column: np.ndarray, agreement: Agreement) -> None:
    upper, gain, phase, coherence = column
    f = agreement.response.frequency
    found = np.linalg.svd(agreement.response.matrix, compute_uv=False)
    expected = np.linalg.svd(agreement.reference, compute_uv=False)
    for i, colour in enumerate(AXES):
        label = f"value {i + 1}, measured"
        upper.semilogx(f, 20.0 * np.log10(found[:, i]), ".", color=colour, markersize=4.0, label=label)
        upper.semilogx(f, 20.0 * np.log10(expected[:, i]), color="black", linewidth=0.9)
        gain.semilogx(f, agreement.deviation_db[:, i], color=colour, linewidth=1.0)
        phase.semilogx(f, agreement.deviation_deg[:, i], color=colour, linewidth=1.0)
    upper.plot([], [], color="black", linewidth=0.9, label="closed form")
    _limits(gain, ALLOWED_DB, agreement.largest_db.max())
    _limits(phase, ALLOWED_DEG, agreement.largest_deg.max())
    coherence.loglog(f, np.maximum(1.0 - agreement.response.coherence.min(axis=1), 1e-16), color=REFERENCE)
    upper.set(xlim=BAND, ylim=(-90.0, 50.0))
    upper.set_xticks([0.2, 1, 10, 100], ["0.2", "1", "10", "100"])


def _limits(axes: Axes, allowed: float, largest: float) -> None:
    for sign in (-1.0, 1.0):
        axes.axhline(sign * allowed, color=REFERENCE, linestyle="--", linewidth=1.0)
    limit = max(1.5 * allowed, 1.1 * largest)
    axes.set_ylim(-limit, limit)
