"""Pictures of the stability analysis: loop, Nyquist curves, sensitivity, and the motion after the pulse; its charts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ....analyses.result import paint_pictures
from ....mechanism.parameters import Array
from ....results.page.content import Axis, Chart, ChartGroup, Curve, Exploration, Still
from ....results.report import Picture
from ....results.style import ACTIVE, PASSIVE, REFERENCE
from ....theory.small_gain import largest_singular_value, nominal_loop_poles
from ....theory.transfer_matrices import Complex, place_frequencies
from ...bus_cases import COLOURS, assemble_nominal, load_case, small_gain_curves
from .closed_form import LoopVerdict
from .runs import OpenLoop, PulseResponse, compare_by_name

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLUMNS = 3
COLOURS_OF = {"passive": PASSIVE, "active": ACTIVE}
LABELS = {"passive": "isolator off", "active": "isolator on"}
AFTER = "After a pulse on the bus, isolator with 20 ms delay unless said otherwise"
BIN_S = 0.2  # of an envelope: one cycle at 5 Hz
READINGS = ((-1.0, "det(E - L): by (48)"), (1.0, "det(E + L): as the paper reads it"))
DRAWN = 20.0  # Hz, end of the Nyquist curves; beyond, the delay winds them about one again and again
CLOSE = (-0.6, 2.2)  # of the real part: OSM, LDOSM and LDLSM stay near one
# Hz, where an arrow shows the direction of a curve: around the resonance of the suspension, if there is one.
ARROWS = {"OSM": (5.0, 5.3), "LSM": (5.0, 5.3, 5.7), "LDOSM": (8.0,), "LDLSM": (4.0, 12.0)}


def paint_bode(figure: Figure, verdicts: Mapping[str, LoopVerdict], opened: Mapping[str, OpenLoop]) -> None:
    """Gain and phase of L11, as in Fig 10, with what was measured on the FMUs."""
    frequency = np.geomspace(1.0, 300.0, 3000)  # Hz
    dots: dict[str, Any] = {"marker": "o", "markersize": 4.0, "linestyle": "none", "color": "k", "fillstyle": "none"}
    gain, phase = figure.subplots(2, 1, sharex=True)
    for case, verdict in verdicts.items():
        L = verdict.loop.transfer(2j * np.pi * frequency)[:, 0, 0]
        gain.semilogx(frequency, 20.0 * np.log10(np.abs(L)), color=COLOURS[case], label=case)
        shown = frequency < 30.0  # beyond, the delay turns the phase too fast to be read
        phase.semilogx(frequency[shown], break_jumps(np.degrees(np.angle(L)))[shown], color=COLOURS[case])
        measured = opened[case]
        f, values = measured.response.frequency, measured.values
        some = np.unique(np.searchsorted(f, np.geomspace(f[0], f[-1], 90)).clip(max=len(f) - 1))
        gain.semilogx(f[some], 20.0 * np.log10(np.abs(values[some])), **dots)
        some = some[f[some] < 30.0]
        phase.semilogx(f[some], np.degrees(np.angle(values[some])), **dots)
    gain.plot([], [], **dots, label="on the FMUs")
    gain.axhline(0.0, color=REFERENCE, linestyle="--", linewidth=1.0)
    for critical in (-180.0, 0.0):
        phase.axhline(critical, color=REFERENCE, linestyle="--", linewidth=1.0)
    phase.text(32.0, 6.0, "critical by (48)", color=REFERENCE)
    phase.text(32.0, -172.0, "critical as the paper reads it", color=REFERENCE)
    gain.set(ylabel="gain of L11 (dB)", ylim=(-75.0, 20.0))
    phase.set(ylabel="phase of L11 (deg)", xlabel="frequency (Hz)", yticks=np.arange(-180.0, 181.0, 90.0))
    ticks = [1, 2, 5, 10, 20, 50, 100, 200]
    phase.set_xticks(ticks, [f"{tick}" for tick in ticks])
    gain.legend(ncols=5, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    figure.suptitle("Loop transfer function, element (1, 1), delay 0.02 s")


def paint_nyquist(figure: Figure, verdicts: Mapping[str, LoopVerdict]) -> None:
    """det(E - L) with the critical point at the origin, beside det(E + L), the paper's reading; below, seen closely."""
    panels = figure.subplots(2, 2, height_ratios=(1.5, 1.0))
    for case, v in verdicts.items():
        frequency = np.union1d(place_frequencies(v.poles, 1e-3, DRAWN, 2000), np.linspace(4.5, 6.5, 500))  # Hz
        eigenvalues = _eigenvalues(v, frequency)
        ends = _eigenvalues(v, np.add.outer(ARROWS[case], [0.0, 0.01]))
        for (upper, lower), (sign, _) in zip(panels.T, READINGS, strict=True):
            curve = _determinant(eigenvalues, sign)
            for axes in (upper, lower):
                axes.plot(curve.real, curve.imag, color=COLOURS[case], label=case)
                axes.plot(curve.real, -curve.imag, color=COLOURS[case], linewidth=0.6)
            _draw_arrows(upper if case == "LSM" else lower, _determinant(ends, sign), COLOURS[case])
    for (upper, lower), (sign, title) in zip(panels.T, READINGS, strict=True):
        turns = (f"{case} {v.unstable_poles if sign < 0.0 else v.encirclements}" for case, v in verdicts.items())
        upper.set_title(f"{title}\nturns about +: {', '.join(turns)}")
        lower.set(xlim=CLOSE, ylim=(-0.75, 0.75), xlabel="real part", title="the same, near the origin")
        for axes in (upper, lower):
            axes.plot(0.0, 0.0, "+", color="black", markersize=16.0, markeredgewidth=2.5)
            axes.set(ylabel="imaginary part", aspect="equal")
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=4)
    figure.suptitle(f"Nyquist curves with delay 0.02 s, up to {DRAWN:g} Hz; thin: negative frequencies")


def distance_beyond(verdicts: Mapping[str, LoopVerdict]) -> float:
    """Largest distance of det(E - L) and det(E + L) from one, beyond what the Nyquist figure shows."""
    frequencies = [place_frequencies(v.loop.plant_poles(), DRAWN, 1e4, 2000) for v in verdicts.values()]  # Hz
    eigenvalues = [_eigenvalues(v, f) for v, f in zip(verdicts.values(), frequencies, strict=True)]
    return max(float(np.abs(_determinant(e, sign) - 1.0).max()) for e in eigenvalues for sign, _ in READINGS)


def _eigenvalues(verdict: LoopVerdict, frequency: Array) -> Complex:
    return verdict.loop.eigenvalues(2j * np.pi * frequency)


def _determinant(eigenvalues: Complex, sign: float) -> Complex:
    """det(E + sign L) from the eigenvalues of L (..., 3)."""
    return np.asarray(np.prod(1.0 + sign * eigenvalues, axis=-1))


def _draw_arrows(axes: Axes, ends: Complex, colour: str) -> None:
    """Arrow heads from the first to the second of the points (n, 2)."""
    for start, end in ends:
        axes.annotate(
            "", (end.real, end.imag), (start.real, start.imag),
            arrowprops={"arrowstyle": "-|>", "color": colour, "mutation_scale": 20.0},
        )  # fmt: skip


def paint_sensitivity(figure: Figure, verdicts: Mapping[str, LoopVerdict]) -> None:
    """Largest singular value of S of the practical loop; below, the left-hand side of the small-gain condition."""
    upper, lower = figure.subplots(2, 1, sharex=True)
    for case, verdict in verdicts.items():
        frequency = place_frequencies(verdict.poles, 0.1, 300.0, 3000)
        S = largest_singular_value(verdict.loop.sensitivity(2j * np.pi * frequency))
        upper.semilogx(frequency, S, color=COLOURS[case], label=case)
        frequency = place_frequencies(nominal_loop_poles(assemble_nominal(load_case(case))), 0.1, 300.0, 3000)
        left, bound = small_gain_curves(case, frequency, verdict.loop.delay)
        lower.loglog(frequency, left, color=COLOURS[case])
        lower.loglog(frequency, bound, color=COLOURS[case], linestyle=":", linewidth=1.2)
    lower.axhline(1.0, color=REFERENCE, linestyle="--")
    lower.text(0.11, 1.3, "certainly stable below", color=REFERENCE)
    lower.plot([], [], color=REFERENCE, linestyle="-", label="with T of (63)")
    lower.plot([], [], color=REFERENCE, linestyle=":", label="with the bound (64)")
    upper.set_ylabel("largest singular value of S")
    lower.set(ylabel="sigma(T) |Delta| of (62)", xlabel="frequency (Hz)", ylim=(1e-4, 100.0))
    ticks = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200]
    lower.set_xticks(ticks, [f"{tick:g}" for tick in ticks])
    upper.legend(ncols=4, loc="lower center", bbox_to_anchor=(0.5, 1.0))
    lower.legend(loc="upper right")
    figure.suptitle("Sensitivity with delay 0.02 s, and the small-gain condition")


def break_jumps(angle: Array) -> Array:
    """Angles, deg, with NaN where they jump, so that no line crosses the plot."""
    broken = angle.copy()
    broken[1:][np.abs(np.diff(angle)) > 180.0] = np.nan
    return broken


def paint_fine_legs(figure: Figure, responses: Sequence[PulseResponse]) -> None:
    """Envelope of the fine displacements, logarithmic, and the rate of the predicted pole."""
    shown = compare_by_name(responses)
    grid = figure.subplots(2, COLUMNS).reshape(-1)
    for axes, (name, compared) in zip(grid, shown.items(), strict=False):
        for r in compared:
            time, largest = _envelope(r.time, np.abs(r.fine).max(axis=1))
            axes.semilogy(time, 1e6 * largest, color=COLOURS_OF[r.mode], label=LABELS[r.mode])
            if r.enabled:
                # Through the end of an unstable motion; through the start of a stable one, when the pulse has ended.
                k = -1 if r.predicted.real > 0.0 else 2
                rate = largest[k] * np.exp(r.predicted.real * (time - time[k]))
                seen = (time >= time[2]) & (rate > 0.3 * largest.min())
                axes.semilogy(time[seen], 1e6 * rate[seen], "k--", lw=1.2, label="rate of the predicted pole")
        axes.set_title(name)
        axes.set_xlabel("time (s)")
    for axes in grid[len(shown) :]:
        axes.axis("off")
    for axes in grid[::COLUMNS]:
        axes.set_ylabel("fine displacement (µm)")
    grid[-1].legend(*grid[0].get_legend_handles_labels(), loc="center")
    figure.suptitle(AFTER)


def _envelope(time: Array, values: Array) -> tuple[Array, Array]:
    """Largest value in each bin; the last one, which may not be full, is left out."""
    bins = (time / BIN_S + 1e-9).astype(int)
    starts = np.flatnonzero(np.diff(bins, prepend=-1))
    return time[starts[:-1]], np.maximum.reduceat(values, starts)[:-1]


def draw_fine_legs(folder: Path, responses: Sequence[PulseResponse]) -> list[Picture]:
    """The picture of the fine legs, painted into a folder."""
    caption = (
        "Largest displacement of a fine leg; dashed: rate of the predicted pole. In the end only the modes of the "
        "arrays are left, with time constants of 20 to 70 s; with large damping from 0.6 s on."
    )
    return paint_pictures(folder, "stability", ("fine", caption, (14.0, 8.0), paint_fine_legs, responses))


def explore_responses(responses: Sequence[PulseResponse]) -> Exploration:
    """Charts of the payload's rotation and of a fine leg, one for each case, isolator off and on."""
    axis = Axis("time", "s", responses[0].time)
    title = "Payload about axis x after a pulse on the bus, 20 ms delay unless said otherwise"
    still = Still("stability_payload.png", title, caption="Rotation of the payload about the first axis.")
    groups = []
    for title, unit, motion, stills in (
        ("Rotation of the payload about axis x of P", "rad", "rotation", [still]),
        ("Displacement of fine leg 1", "m", "fine", []),
    ):
        charts = [
            Chart(name, unit, [Curve(LABELS[r.mode], r.mode, getattr(r, motion)[:, 0]) for r in compared])
            for name, compared in compare_by_name(responses).items()
        ]
        groups.append(ChartGroup(title, "After a pulse on the bus.", axis, charts, stills=stills))
    return Exploration(groups)
