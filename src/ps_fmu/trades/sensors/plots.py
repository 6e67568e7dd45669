"""The figures of the trade: which accelerometer, which corner, what a bias does."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...results.style import ACTIVE, PASSIVE, REFERENCE, draw
from .measured import BIAS_CORNER, BiasAnswer, Point
from .results import CLASSES, CROSSOVERS, DENSITIES, MICRO_G, Trade

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOP_COLOURS = dict(zip(CROSSOVERS, (ACTIVE, "#009E73", "#CC79A7"), strict=True))  # Okabe and Ito
CLASS_COLOURS = dict(zip(CLASSES, ("#0072B2", "#009E73", "#E69F00", "#D55E00"), strict=True))
MARKERS = dict(zip(CLASSES, "osD^", strict=True))
MICRO = 1e6  # urad in a rad


def draw_choice(path: Path, trade: Trade, points: Sequence[Point]) -> None:
    """Jitter over noise density: curves by corner, the best corner with and without loop, markers of the classes."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        density = DENSITIES / MICRO_G
        of_corners = trade.white[None].with_density(DENSITIES)
        tops = [min(int(np.searchsorted(curve, 1.7e-4)), len(density) - 1) for curve in of_corners.T]
        at_top: dict[int, list[int]] = {}  # curves by where they leave; those that leave at the right lie together
        for i in range(0, len(trade.corners), 3):
            axes.loglog(density, of_corners[:, i] * MICRO, color="#A9C9DE", lw=0.9)
            at_top.setdefault(tops[i], []).append(i)
        for top, curves in at_top.items():
            axes.annotate(
                ", ".join(f"{trade.corners[i]:.2g}" for i in curves) + " Hz",
                (density[top], of_corners[top, curves[0]] * MICRO), fontsize=9, color="#5B8FAF", ha="right",
                rotation=55,
            )  # fmt: skip
        axes.plot([], [], color="#A9C9DE", lw=0.9, label="no loop, high-pass corner as written (curves: white noise)")
        for crossover, sweep in trade.white.items():
            label = "no loop" if crossover is None else f"loop with crossover at {crossover:g} Hz"
            axes.loglog(
                density, sweep.with_density(DENSITIES).min(axis=1) * MICRO, color=LOOP_COLOURS[crossover], lw=2.8,
                label=f"best corner, {label}",
            )  # fmt: skip
        axes.axhline(trade.passive * MICRO, color=PASSIVE, ls="--", label="passive, no loop")
        for crossover, value in trade.loops_alone.items():
            axes.axhline(value * MICRO, color=LOOP_COLOURS[crossover], ls=":", lw=1.3)
        axes.plot([], [], color=REFERENCE, ls=":", lw=1.3, label="loop alone, isolator off")
        for name, found in trade.classes.items():
            x = found.sensors.accelerometer.noise_density / MICRO_G
            for crossover, sweep in found.sweeps.items():
                axes.plot(x, sweep.rms.min() * MICRO, MARKERS[name], color=LOOP_COLOURS[crossover], mec="black", ms=9)
            best = min((p for p in points if p.name == name), key=lambda p: p.expected, default=None)
            if best is not None:
                axes.plot(x, best.measured * MICRO, "x", color="black", ms=9, mew=2)
            axes.annotate(name, (x, 0.12), ha="center", fontsize=12)
            axes.axvline(x, color="#DDDDDD", lw=1.0, zorder=0)
        axes.plot([], [], "o", color="white", mec="black", ms=9, label="class of parts, its best corner, closed form")
        axes.plot([], [], "x", color="black", mew=2, ms=9, ls="none", label="the same on the FMUs, no loop")
        axes.set(
            xlabel="noise density of an accelerometer (\N{MICRO SIGN}g/\N{SQUARE ROOT}Hz, one-sided)",
            ylabel="jitter of the line of sight, RMS (\N{MICRO SIGN}rad)",
            xlim=(density[0], density[-1]), ylim=(0.1, 200.0),
        )  # fmt: skip
        figure.legend(loc="outside lower center", ncols=2, fontsize=11)
        figure.suptitle("Which accelerometer for which jitter?  Nine of them, 0.5 m from the axis")

    draw(path, 11.5, 9.5, paint)


def draw_corners(path: Path, trade: Trade, points: Sequence[Point]) -> None:
    """For each class: jitter over corner, its parts, and the points of the FMUs with two standard deviations."""

    def paint(figure: Figure) -> None:
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        for axes, (name, found) in zip(panels.flat, trade.classes.items(), strict=True):
            sweep = found.sweeps[None]
            left, noise = (np.sqrt(part) * MICRO for part in (sweep.disturbance, sweep.sensors))
            axes.loglog(trade.corners, left, "--", color=PASSIVE, label="disturbance that is left")
            axes.loglog(trade.corners, noise, "--", color="#009E73", label="noise of the sensors")
            axes.loglog(trade.corners, sweep.rms * MICRO, color=ACTIVE, lw=2.2, label="both, no loop")
            looped = found.sweeps[CROSSOVERS[-1]]
            label = f"all, loop with crossover at {CROSSOVERS[-1]:g} Hz"
            axes.loglog(trade.corners, looped.rms * MICRO, color=LOOP_COLOURS[CROSSOVERS[-1]], lw=2.2, label=label)
            for each, colour in ((sweep, ACTIVE), (looped, LOOP_COLOURS[CROSSOVERS[-1]])):
                axes.plot(trade.corners[each.best], each.rms[each.best] * MICRO, "o", color=colour, mec="black", ms=8)
            own = [p for p in points if p.name == name]
            axes.errorbar(
                [p.corner for p in own], [p.measured * MICRO for p in own],
                yerr=[2.0 * p.scatter * p.expected * MICRO for p in own], fmt="x", color="black", mew=2, capsize=4,
                label="FMUs, no loop; two standard deviations",
            )  # fmt: skip
            axes.axhline(trade.passive * MICRO, color=REFERENCE, ls=":", lw=1.2, label="passive")
            micro_g = found.sensors.accelerometer.noise_density / MICRO_G
            axes.set(title=f"{name}, {micro_g:.2g} \N{MICRO SIGN}g/\N{SQUARE ROOT}Hz", ylim=(0.1, 1e4))
        for axes in panels[:, 0]:
            axes.set_ylabel("line of sight, RMS (\N{MICRO SIGN}rad)")
        _label_corner(panels[1])
        figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
        figure.suptitle("The best high-pass corner of the isolator; circles: best")

    draw(path, 12.0, 10.0, paint)


def draw_bias(path: Path, trade: Trade, answer: BiasAnswer) -> None:
    """Left: where a constant bias ends, over the corner.  Right: how the payload goes there."""

    def paint(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for name, found in trade.classes.items():
            spread = found.sensors.accelerometer.bias_spread / MICRO_G
            if spread:
                label = f"{name}: {spread:.2g} \N{MICRO SIGN}g each"
                left.loglog(trade.corners, found.offsets * MICRO, color=CLASS_COLOURS[name], label=label)
        left.axhline(trade.passive * MICRO, color=REFERENCE, ls=":", lw=1.2, label="passive jitter")
        left.set(ylabel="constant offset of the line of sight (\N{MICRO SIGN}rad)", title="In the end, no loop")
        _label_corner([left])
        left.legend(fontsize=11)
        right.plot(answer.time, answer.measured * MICRO, color=ACTIVE, lw=4.0, alpha=0.5, label="FMUs")
        right.plot(answer.time, answer.expected * MICRO, "--", color="black", label="closed form")
        right.set(
            xlabel="time (s)", ylabel="rotation of the payload about x (\N{MICRO SIGN}rad)",
            title=f"From the start: 1 \N{MICRO SIGN}g on one sensor, {BIAS_CORNER:g} Hz",
        )  # fmt: skip
        right.legend(fontsize=11)
        figure.suptitle("What a bias does")

    draw(path, 12.0, 6.0, paint)


def _label_corner(lowest: Sequence[Axes]) -> None:
    for axes in lowest:
        axes.set(xlabel="corner of the isolator's high-pass (Hz)")
        axes.set_xticks([0.01, 0.1, 1.0], ["0.01", "0.1", "1"])
