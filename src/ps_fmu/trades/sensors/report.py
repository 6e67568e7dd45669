"""The trade of accelerometers: closed form, runs of the FMUs beside it, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from ...analyses.result import AnalysisResult, paint_pictures, tabulate
from ...analyses.system import load_own_systems
from ...analyses.table import AnalysisOptions
from ...mechanism.parameters import Array
from ...product.files import find_product
from ...results.style import ACTIVE, PASSIVE, REFERENCE
from ...results.tables import Table
from .results import (
    BIAS_HIGHPASS,
    CLASSES,
    CROSSOVERS,
    DENSITIES,
    HIGHPASSES,
    MEASURED_HIGHPASSES,
    MICRO_G,
    SETTLED,
    BiasAnswer,
    Point,
    Trade,
    compute_trade,
    keep_noise,
    measure_bias,
    measure_points,
    needed_density,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DURATION = 100.0  # s, of each run: one period of the disturbance
GOALS = (1e-5, 3e-6, 1e-6, 5e-7)  # rad
LOOP_COLOURS = dict(zip(CROSSOVERS, (ACTIVE, "#009E73", "#CC79A7"), strict=True))  # Okabe and Ito
CLASS_COLOURS = dict(zip(CLASSES, ("#0072B2", "#009E73", "#E69F00", "#D55E00"), strict=True))
MARKERS = dict(zip(CLASSES, "osD^", strict=True))
MICRO = 1e6  # urad in a rad


def analyse(
    options: AnalysisOptions,
    duration: float = DURATION,
    measured_highpasses: Mapping[str, tuple[float, ...]] = MEASURED_HIGHPASSES,
    highpasses: Array = HIGHPASSES,
    points: int = 500,
) -> AnalysisResult:
    """Compute the trade, run the FMUs for ``duration``, s, compare and draw.

    ``highpasses``: high-pass frequencies, Hz; ``measured_highpasses``: those of the runs of each class; ``points``:
    frequencies of the integrals besides those around the resonances.
    """
    system, left = keep_noise(load_own_systems(options)[0])
    trade = compute_trade(find_product().system / "parameters", highpasses, points, system)
    runs = sum(map(len, measured_highpasses.values())) + 1
    with tqdm(total=runs, unit="run", desc="sensors", disable=not options.progress) as bar:
        answer = measure_bias(system, trade.design)
        bar.update()
        measured = measure_points(system, trade, duration, options.seed, measured_highpasses, bar.update)
    return AnalysisResult(
        name="sensors",
        title="Which accelerometer does the isolator need?",
        text=[
            *paragraphs(trade, measured, answer, duration),
            *([f"Left out, since the trade is of the noise alone: {', '.join(left)}."] if left else []),
        ],
        tables=[_goal_table(trade), _class_table(trade), _point_table(measured)],
        pictures=paint_pictures(
            options.output,
            "sensors",
            (
                "choice",
                "Which accelerometer for which jitter: RMS of the line of sight over the noise of the accelerometers.",
                (11.5, 9.5), paint_choice, trade, measured,
            ),
            (
                "highpass",
                "Jitter over the isolator's high-pass frequency for each class, in closed form and on the FMUs.",
                (12.0, 10.0), paint_highpass, trade, measured,
            ),
            (
                "bias",
                "What a bias does: where the line of sight ends over the high-pass frequency, and how it goes there.",
                (12.0, 6.0), paint_bias, trade, answer,
            ),
        ),
        data=_entry(trade, measured, answer),
    )  # fmt: skip


def paragraphs(trade: Trade, measured: Sequence[Point], answer: BiasAnswer, duration: float) -> list[str]:
    """What was computed and measured, and what follows."""
    last = CROSSOVERS[-1]
    best = {name: min(found.sweeps[None].rms) for name, found in trade.classes.items()}
    helped = [name for name, value in best.items() if value < trade.passive]
    looped = {name: min(found.sweeps[last].rms) for name, found in trade.classes.items()}
    better = [name for name, value in looped.items() if value < trade.loops_alone[last]]
    worst = max(measured, key=lambda p: abs(p.deviations), default=None)
    accelerometers = int(np.count_nonzero(trade.design.sensors.enabled[:12]))
    error = float(np.abs(answer.measured - answer.expected).max() / np.abs(answer.expected).max())
    return [
        "The isolator integrates the measured acceleration of the base twice. Noise of the accelerometers does so too: "
        "its share of the variance falls with the third power of the high-pass frequency, while below this frequency "
        "the disturbance is left. So each class of parts has a best high-pass frequency. All numbers are the RMS "
        f"rotation of the line of sight, about x and y of P together, with {accelerometers} accelerometers. An arm "
        "twice as long halves the noise of the angular acceleration.",
        f"Passive jitter is {_micro(trade.passive)} urad. Without a line-of-sight loop these classes bring less than "
        f"that at the best high-pass frequency: {', '.join(helped) or 'none'}. All classes: "
        + ", ".join(f"{name} {_show(value)}" for name, value in best.items())
        + ".",
        f"A line-of-sight loop with a crossover of {last:g} Hz alone, isolator off, "
        f"{_say_left(trade.loops_alone[last])}. With the best high-pass frequency of the isolator: "
        + ", ".join(f"{name} {_show(value)}" for name, value in looped.items())
        + f". Better than the loop alone: {', '.join(better) or 'none'}. The loop has the design and the tracker that "
        "are the defaults of its FMUs; for lower crossovers its integral frequency falls in proportion.",
        "A constant bias ends as a constant offset, of bias over high-pass frequency squared (rad/s2 and rad/s). On "
        f"the FMUs the answer to a bias of 1 ug of one sensor, high-pass {BIAS_HIGHPASS:g} Hz, is that of the closed "
        f"form within {100.0 * error:.1f} % of its largest value. The line-of-sight loop integrates twice at low "
        "frequencies, and takes the offset away, as long as it lies within the strokes and the field of view.",
        "The loop is unstable at all of these high-pass frequencies, so the FMUs were not run."
        if worst is None
        else f"The runs of the FMUs (multisine disturbance, one period of {duration:g} s) deviate from the closed form "
        f"of its lines by up to {100.0 * max(abs(p.deviation) for p in measured):.1f} %, and by "
        f"{abs(worst.deviations):.1f} standard deviations of the sensors' noise in a record as long at most "
        f"({worst.name}, {worst.highpass:g} Hz). Each run begins when the high-pass has settled, and modes that "
        f"matter: those that have not settled keep {100.0 * SETTLED:g} % of the variance each at most.",
        _describe_unstable(trade),
        "The figures of the classes and their sources are in system/parameters/sensors_*.ssv; several are assumed, and "
        "say so.",
    ]


def _describe_unstable(trade: Trade) -> str:
    """At which high-pass frequencies loops are unstable: poles are counted before anything that presumes stability."""
    found = [
        f"{name} at {', '.join(f'{highpass:.2g}' for highpass in trade.highpasses[~np.isfinite(sweep.rms)])} Hz, loop: "
        f"{_describe(crossover)}"
        for name, one in trade.classes.items()
        for crossover, sweep in one.sweeps.items()
        if not np.isfinite(sweep.rms).all()
    ]
    said = f"these are unstable, and no candidates: {'; '.join(found)}" if found else "all are stable"
    return f"Poles of the closed loops are counted for each class, high-pass frequency and line-of-sight loop: {said}."


def _goal_table(trade: Trade) -> Table:
    rows = []
    for goal in GOALS:
        densities = [needed_density(trade, crossover, goal) for crossover in CROSSOVERS]
        rows.append((_micro(goal), *("-" if d is None else f"{d / MICRO_G:.2g}" for d in densities)))
    header = ("jitter (urad)", *(_describe(crossover) for crossover in CROSSOVERS))
    caption = "Largest noise density (ug/sqrt(Hz)) that reaches a jitter, at the best high-pass frequency; -: none does"
    return Table(caption, header, rows)


def _class_table(trade: Trade) -> Table:
    rows = []
    for name, found in trade.classes.items():
        for crossover, sweep in found.sweeps.items():
            k = sweep.best
            rows.append(
                (
                    name if crossover is None else "",
                    _describe(crossover),
                    f"{trade.highpasses[k]:.2g}",
                    *(_micro(value) for value in (sweep.rms[k], *np.sqrt([sweep.disturbance[k], sweep.sensors[k]]))),
                    _micro(found.offsets[k]) if crossover is None else "0",
                )
            )
    header = (
        "class", "line-of-sight loop", "best high-pass (Hz)", "jitter (urad)", "by disturbance", "by sensors",
        "offset by bias (urad)",
    )  # fmt: skip
    return Table("The best high-pass frequency of each class", header, rows)


def _point_table(measured: Sequence[Point]) -> Table:
    return tabulate(
        "Closed form and runs of the FMUs, no line-of-sight loop",
        measured,
        (
            ("class", lambda p: p.name),
            ("high-pass (Hz)", lambda p: f"{p.highpass:g}"),
            ("closed form (urad)", lambda p: _micro(p.expected)),
            ("FMUs (urad)", lambda p: _micro(p.measured)),
            ("difference (%)", lambda p: f"{100.0 * p.deviation:+.1f}"),
            ("standard deviation (%)", lambda p: f"{100.0 * p.scatter:.1f}"),
        ),
    )


def _describe(crossover: float | None) -> str:
    return "none" if crossover is None else f"{crossover:g} Hz"


def _show(value: float) -> str:
    return f"{_micro(value)} urad" if np.isfinite(value) else _micro(value)


def _say_left(value: float) -> str:
    return f"leaves {_show(value)}" if np.isfinite(value) else "is unstable"


def _micro(value: float) -> str:
    return f"{1e6 * value:.3g}" if np.isfinite(value) else "unstable"


def _entry(trade: Trade, measured: Sequence[Point], answer: BiasAnswer) -> dict[str, object]:
    return {
        "passive_rad": trade.passive,
        "loop_alone_rad": {f"{crossover:g}": value for crossover, value in trade.loops_alone.items()},
        "highpass_frequencies_Hz": trade.highpasses,
        "classes": {
            name: {
                "noise_density": found.sensors.accelerometer.noise_density,
                "offset_rad": found.offsets,
                **{
                    f"jitter_rad, loop {_describe(crossover)}": sweep.rms for crossover, sweep in found.sweeps.items()
                },
            }
            for name, found in trade.classes.items()
        },
        "runs": [
            {
                "class": p.name, "highpass_frequency_Hz": p.highpass, "measured_rad": p.measured,
                "expected_rad": p.expected,
                "relative_standard_deviation": p.scatter,
            }
            for p in measured
        ],
        "bias": {"time_s": answer.time, "measured_rad": answer.measured, "expected_rad": answer.expected},
    }  # fmt: skip


def paint_choice(figure: Figure, trade: Trade, points: Sequence[Point]) -> None:
    """Jitter over noise density: curves by high-pass, the best with and without loop, markers of classes."""
    axes = figure.subplots()
    density = DENSITIES / MICRO_G
    of_highpasses = trade.white[None].with_density(DENSITIES)
    tops = [min(int(np.searchsorted(curve, 1.7e-4)), len(density) - 1) for curve in of_highpasses.T]
    at_top: dict[int, list[int]] = {}  # curves by where they leave; those that leave at the right lie together
    for i in range(0, len(trade.highpasses), 3):
        axes.loglog(density, of_highpasses[:, i] * MICRO, color="#A9C9DE", lw=0.9)
        at_top.setdefault(tops[i], []).append(i)
    for top, curves in at_top.items():
        axes.annotate(
            ", ".join(f"{trade.highpasses[i]:.2g}" for i in curves) + " Hz",
            (density[top], of_highpasses[top, curves[0]] * MICRO), fontsize=11, color="#2F6F95", ha="right",
            rotation=55,
        )  # fmt: skip
    axes.plot(
        [], [], color="#A9C9DE", lw=0.9, label="no loop, high-pass at the written frequency (curves: white noise)"
    )
    for crossover, sweep in trade.white.items():
        label = "no loop" if crossover is None else f"loop with crossover at {crossover:g} Hz"
        axes.loglog(
            density, sweep.with_density(DENSITIES).min(axis=1) * MICRO, color=LOOP_COLOURS[crossover], lw=2.8,
            label=f"best high-pass, {label}",
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
    axes.plot([], [], "o", color="white", mec="black", ms=9, ls="none", label="a class of parts, white noise and drift")
    axes.plot([], [], "x", color="black", mew=2, ms=9, ls="none", label="the same on the FMUs, no loop")
    axes.set(
        xlabel="noise density of an accelerometer (\N{MICRO SIGN}g/\N{SQUARE ROOT}Hz, one-sided)",
        ylabel="jitter of the line of sight, RMS (\N{MICRO SIGN}rad)",
        xlim=(density[0], density[-1]), ylim=(0.1, 200.0),
    )  # fmt: skip
    figure.legend(loc="outside lower center", ncols=2, fontsize=11)
    figure.suptitle("Which accelerometer for which jitter?")


def paint_highpass(figure: Figure, trade: Trade, points: Sequence[Point]) -> None:
    """For each class: jitter over high-pass frequency, its parts, points of the FMUs with two standard deviations."""
    panels = figure.subplots(2, 2, sharex=True, sharey=True)
    for axes, (name, found) in zip(panels.flat, trade.classes.items(), strict=True):
        sweep = found.sweeps[None]
        left, noise = (np.sqrt(part) * MICRO for part in (sweep.disturbance, sweep.sensors))
        axes.loglog(trade.highpasses, left, "--", color=PASSIVE, label="disturbance that is left")
        axes.loglog(trade.highpasses, noise, "--", color="#009E73", label="noise of the sensors")
        axes.loglog(trade.highpasses, sweep.rms * MICRO, color=ACTIVE, lw=2.2, label="both, no loop")
        looped = found.sweeps[CROSSOVERS[-1]]
        label = f"all, loop with crossover at {CROSSOVERS[-1]:g} Hz"
        axes.loglog(trade.highpasses, looped.rms * MICRO, color=LOOP_COLOURS[CROSSOVERS[-1]], lw=2.2, label=label)
        for each, colour in ((sweep, ACTIVE), (looped, LOOP_COLOURS[CROSSOVERS[-1]])):
            axes.plot(trade.highpasses[each.best], each.rms[each.best] * MICRO, "o", color=colour, mec="black", ms=8)
        own = [p for p in points if p.name == name]
        axes.errorbar(
            [p.highpass for p in own], [p.measured * MICRO for p in own],
            yerr=[2.0 * p.scatter * p.expected * MICRO for p in own], fmt="x", color="black", mew=2, capsize=4,
            label="FMUs, no loop; two standard deviations",
        )  # fmt: skip
        axes.axhline(trade.passive * MICRO, color=REFERENCE, ls=":", lw=1.2, label="passive")
        micro_g = found.sensors.accelerometer.noise_density / MICRO_G
        axes.set(title=f"{name}, {micro_g:.2g} \N{MICRO SIGN}g/\N{SQUARE ROOT}Hz", ylim=(0.1, 1e4))
    for axes in panels[:, 0]:
        axes.set_ylabel("line of sight, RMS (\N{MICRO SIGN}rad)")
    _label_highpass(panels[1])
    figure.legend(*panels[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle("The best high-pass frequency of the isolator; circles: best")


def paint_bias(figure: Figure, trade: Trade, answer: BiasAnswer) -> None:
    """Left: where a constant bias ends, over the high-pass frequency.  Right: how the payload goes there."""
    left, right = figure.subplots(1, 2)
    for name, found in trade.classes.items():
        spread = found.sensors.accelerometer.bias_spread / MICRO_G
        if spread:
            label = f"{name}: {spread:.2g} \N{MICRO SIGN}g each"
            left.loglog(trade.highpasses, found.offsets * MICRO, color=CLASS_COLOURS[name], label=label)
    left.axhline(trade.passive * MICRO, color=REFERENCE, ls=":", lw=1.2, label="passive jitter")
    left.set(ylabel="constant offset of the line of sight (\N{MICRO SIGN}rad)", title="In the end, no loop")
    _label_highpass([left])
    left.legend(fontsize=11)
    right.plot(answer.time, answer.measured * MICRO, color=ACTIVE, lw=4.0, alpha=0.5, label="FMUs")
    right.plot(answer.time, answer.expected * MICRO, "--", color="black", label="closed form")
    right.set(
        xlabel="time (s)", ylabel="rotation of the payload about x (\N{MICRO SIGN}rad)",
        title=f"From the start: 1 \N{MICRO SIGN}g on one sensor, {BIAS_HIGHPASS:g} Hz",
    )  # fmt: skip
    right.legend(fontsize=11)
    figure.suptitle("What a bias does")


def _label_highpass(lowest: Sequence[Axes]) -> None:
    for axes in lowest:
        axes.set(xlabel="high-pass frequency of the isolator (Hz)")
        axes.set_xticks([0.01, 0.1, 1.0], ["0.01", "0.1", "1"])
