"""Figures of the stability analysis."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..pointing.style import REFERENCE, draw

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from .stability import Verdict

COLOURS = {"OSM": "#0072B2", "LSM": "#D55E00", "LDOSM": "#56B4E9", "LDLSM": "#E69F00"}  # Okabe and Ito


def bode_figure(path: Path, verdicts: Mapping[str, Verdict]) -> None:
    """Gain and phase of L11, as in Fig 10."""
    frequency = np.geomspace(1.0, 30.0, 1500)  # Hz

    def paint(figure: Figure) -> None:
        gain, phase = figure.subplots(2, 1, sharex=True)
        for case, verdict in verdicts.items():
            L = verdict.loop.transfer(2j * np.pi * frequency)[:, 0, 0]
            gain.semilogx(frequency, 20.0 * np.log10(np.abs(L)), color=COLOURS[case], label=case)
            angle = np.degrees(np.angle(L))
            angle[1:][np.abs(np.diff(angle)) > 180.0] = np.nan  # no lines across the plot
            phase.semilogx(frequency, angle, color=COLOURS[case])
        gain.axhline(0.0, color=REFERENCE, linestyle="--", linewidth=1.0)
        for critical in (-180.0, 0.0):
            phase.axhline(critical, color=REFERENCE, linestyle="--", linewidth=1.0)
        phase.text(1.05, 6.0, "critical by (48)", color=REFERENCE)
        phase.text(1.05, -172.0, "critical as the paper reads it", color=REFERENCE)
        gain.set(ylabel="gain of L11 (dB)", ylim=(-75.0, 20.0))
        phase.set(ylabel="phase of L11 (deg)", xlabel="frequency (Hz)", yticks=np.arange(-180.0, 181.0, 90.0))
        phase.set_xticks([1, 2, 5, 10, 20, 30], ["1", "2", "5", "10", "20", "30"])
        gain.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        figure.suptitle("Loop transfer function, element (1, 1), delay 0.02 s")

    draw(path, 10.0, 8.0, paint)


def nyquist_figure(path: Path, verdicts: Mapping[str, Verdict]) -> None:
    """det(E - L) with the critical point at the origin; beside it det(E + L), the paper's reading."""
    frequency = np.unique(np.concatenate([np.geomspace(1e-3, 300.0, 4000), np.linspace(4.5, 6.5, 1000)]))

    def paint(figure: Figure) -> None:
        panels = figure.subplots(1, 2)
        for case, verdict in verdicts.items():
            values = verdict.loop.eigenvalues(2j * np.pi * frequency)
            for axes, sign in zip(panels, (-1.0, 1.0), strict=True):
                curve = np.prod(1.0 + sign * values, axis=-1)
                axes.plot(curve.real, curve.imag, color=COLOURS[case], label=case)
                axes.plot(curve.real, -curve.imag, color=COLOURS[case], linewidth=0.6)
        for axes, title in zip(panels, ("det(E - L): by (48)", "det(E + L): as the paper reads it"), strict=True):
            axes.plot(0.0, 0.0, "+", color="black", markersize=14.0, markeredgewidth=2.0)
            axes.set(title=title, xlabel="real part", ylabel="imaginary part", aspect="equal")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
        figure.suptitle("Nyquist curves with delay 0.02 s; thin: negative frequencies")

    draw(path, 13.0, 7.6, paint)


def sensitivity_figure(path: Path, verdicts: Mapping[str, Verdict]) -> None:
    """Largest singular value of S of the practical loop; below T (63), its bound (64), and what a delay allows."""
    from .stability import small_gain

    frequency = np.geomspace(0.1, 300.0, 1500)  # Hz

    def paint(figure: Figure) -> None:
        upper, lower = figure.subplots(2, 1, sharex=True)
        for case, verdict in verdicts.items():
            S = np.linalg.svd(verdict.loop.sensitivity(2j * np.pi * frequency), compute_uv=False)[:, 0]
            upper.semilogx(frequency, S, color=COLOURS[case], label=case)
            T, bound, allowed = small_gain(verdict, frequency)
            lower.loglog(frequency, T, color=COLOURS[case])
            lower.loglog(frequency, bound, color=COLOURS[case], linestyle=":", linewidth=1.2)
        lower.loglog(frequency, allowed, color=REFERENCE, linestyle="--")
        lower.plot([], [], color=REFERENCE, linestyle="-", label="T of (63)")
        lower.plot([], [], color=REFERENCE, linestyle=":", label="bound (64)")
        lower.plot([], [], color=REFERENCE, linestyle="--", label="1 / |Delta| of the delay: T below is safe (62)")
        upper.set_ylabel("largest singular value of S")
        lower.set(ylabel="largest singular value", xlabel="frequency (Hz)", ylim=(1e-5, 1e3))
        upper.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
        lower.legend(loc="lower right")
        figure.suptitle("Sensitivity with delay 0.02 s, and the small-gain condition")

    draw(path, 10.0, 9.0, paint)
