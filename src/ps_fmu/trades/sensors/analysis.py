"""The trade of accelerometers: closed form, runs of the FMUs beside it, tables and figures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from tqdm import tqdm

from ...analyses.options import AnalysisOptions
from ...analyses.result import AnalysisResult
from ...analyses.system import load_default_system
from ...mechanism.parameters import Array
from ...product.files import find_product
from ...results.report import draw_pictures
from ...results.tables import Table
from .measured import BIAS_CORNER, MEASURED_CORNERS, BiasAnswer, Point, measure_bias, measure_points
from .plots import draw_bias, draw_choice, draw_corners
from .results import CORNERS, CROSSOVERS, MICRO_G, Trade, compute_trade, needed_density

DURATION = 100.0  # s, of each run: one period of the disturbance
GOALS = (1e-5, 3e-6, 1e-6, 5e-7)  # rad


def analyse(
    options: AnalysisOptions,
    duration: float = DURATION,
    measured_corners: Mapping[str, tuple[float, ...]] = MEASURED_CORNERS,
    corners: Array = CORNERS,
    points: int = 500,
) -> AnalysisResult:
    """Compute the trade at ``corners`` (Hz), run the FMUs for ``duration``, s, at some of each class, compare and draw.

    ``points``: frequencies of the integrals besides those around the resonances.
    """
    system = load_default_system(options, "InertialSensors.ssd")
    trade = compute_trade(find_product().system / "parameters", corners, points)
    runs = sum(map(len, measured_corners.values())) + 1
    with tqdm(total=runs, unit="run", desc="sensors", disable=not options.progress) as bar:
        answer = measure_bias(system, trade.isolation)
        bar.update()
        measured = measure_points(system, trade, duration, options.seed, measured_corners, bar.update)
    figures = (
        (
            "choice",
            "Which accelerometer for which jitter: RMS of the line of sight over the noise of the accelerometers.",
            partial(draw_choice, trade=trade, points=measured),
        ),
        (
            "corners",
            "Jitter over the isolator's high-pass corner for each class, in closed form and on the FMUs.",
            partial(draw_corners, trade=trade, points=measured),
        ),
        (
            "bias",
            "What a bias does: where the line of sight ends over the corner, and how it goes there.",
            partial(draw_bias, trade=trade, answer=answer),
        ),
    )
    return AnalysisResult(
        name="sensors",
        title="Which accelerometer does the isolator need?",
        text=paragraphs(trade, measured, answer, duration),
        tables=[_goal_table(trade), _class_table(trade), _point_table(measured)],
        pictures=draw_pictures(options.output, "sensors", figures),
        data=_entry(trade, measured, answer),
    )


def paragraphs(trade: Trade, measured: Sequence[Point], answer: BiasAnswer, duration: float) -> list[str]:
    """What was computed and measured, and what follows."""
    last = CROSSOVERS[-1]
    best = {name: min(found.sweeps[None].rms) for name, found in trade.classes.items()}
    helped = [name for name, value in best.items() if value < trade.passive]
    looped = {name: min(found.sweeps[last].rms) for name, found in trade.classes.items()}
    better = [name for name, value in looped.items() if value < trade.loops_alone[last]]
    worst = max(measured, key=lambda p: abs(p.deviations))
    error = float(np.abs(answer.measured - answer.expected).max() / np.abs(answer.expected).max())
    return [
        "The isolator integrates the measured acceleration of the base twice. Noise of the accelerometers does so too: "
        "its share of the variance falls with the third power of the high-pass corner, while below the corner the "
        "disturbance is left. So each class of parts has a best corner. All numbers are the RMS rotation of the line "
        "of sight, about x and y of P together, with nine accelerometers 0.5 m from the axis of the manipulator. An "
        "arm twice as long halves the noise of the angular acceleration.",
        f"Passive jitter is {_micro(trade.passive)} urad, most of it between 0.1 and 0.2 Hz. Without a line-of-sight "
        f"loop these classes bring less than that at the best corner: {', '.join(helped) or 'none'}. All classes: "
        + ", ".join(f"{name} {_micro(value)} urad" for name, value in best.items())
        + ".",
        f"A line-of-sight loop with a crossover of {last:g} Hz alone, isolator off, leaves "
        f"{_micro(trade.loops_alone[last])} urad. With the isolator's corner moved to suit it: "
        + ", ".join(f"{name} {_micro(value)} urad" for name, value in looped.items())
        + f". Better than the loop alone: {', '.join(better) or 'none'}. The loop has the design and the tracker that "
        "are the defaults of its FMUs; for lower crossovers its integral frequency falls in proportion.",
        "A constant bias ends as a constant offset, of bias over corner squared (rad/s2 and rad/s). On the FMUs the "
        f"answer to a bias of 1 ug of one sensor, corner {BIAS_CORNER:g} Hz, is that of the closed form within "
        f"{100.0 * error:.1f} % of its largest value. The line-of-sight loop integrates twice at low "
        "frequencies, and takes the offset away, as long as it lies within the strokes and the field of view.",
        f"The runs of the FMUs (multisine disturbance, one period of {duration:g} s) deviate from the closed form of "
        f"its lines by up to {100.0 * max(abs(p.deviation) for p in measured):.1f} %, and by "
        f"{abs(worst.deviations):.1f} standard deviations of the sensors' noise in a record as long at most "
        f"({worst.name}, {worst.corner:g} Hz).",
        "The figures of the classes and their sources are in system/parameters/sensors_*.ssv; several are assumed, and "
        "say so.",
    ]


def _goal_table(trade: Trade) -> Table:
    rows = []
    for goal in GOALS:
        densities = [needed_density(trade, crossover, goal) for crossover in CROSSOVERS]
        rows.append((_micro(goal), *("-" if d is None else f"{d / MICRO_G:.2g}" for d in densities)))
    header = ("jitter (urad)", *(_describe(crossover) for crossover in CROSSOVERS))
    caption = "Largest noise density (ug/sqrt(Hz)) that reaches a jitter, at the best corner; -: none does"
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
                    f"{trade.corners[k]:.2g}",
                    *(_micro(value) for value in (sweep.rms[k], *np.sqrt([sweep.disturbance[k], sweep.sensors[k]]))),
                    _micro(found.offsets[k]) if crossover is None else "0",
                )
            )
    header = (
        "class", "line-of-sight loop", "best corner (Hz)", "jitter (urad)", "by disturbance", "by sensors",
        "offset by bias (urad)",
    )  # fmt: skip
    return Table("The best corner of each class", header, rows)


def _point_table(measured: Sequence[Point]) -> Table:
    rows = [
        (
            p.name, f"{p.corner:g}", _micro(p.expected), _micro(p.measured), f"{100.0 * p.deviation:+.1f}",
            f"{100.0 * p.scatter:.1f}",
        )
        for p in measured
    ]  # fmt: skip
    header = ("class", "corner (Hz)", "closed form (urad)", "FMUs (urad)", "difference (%)", "standard deviation (%)")
    return Table("Closed form and runs of the FMUs, no line-of-sight loop", header, rows)


def _describe(crossover: float | None) -> str:
    return "none" if crossover is None else f"{crossover:g} Hz"


def _micro(value: float) -> str:
    return f"{1e6 * value:.3g}"


def _entry(trade: Trade, measured: Sequence[Point], answer: BiasAnswer) -> dict[str, object]:
    return {
        "passive_rad": trade.passive,
        "loop_alone_rad": {f"{crossover:g}": value for crossover, value in trade.loops_alone.items()},
        "corners_Hz": trade.corners,
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
                "class": p.name, "corner_Hz": p.corner, "measured_rad": p.measured, "expected_rad": p.expected,
                "relative_standard_deviation": p.scatter,
            }
            for p in measured
        ],
        "bias": {"time_s": answer.time, "measured_rad": answer.measured, "expected_rad": answer.expected},
    }  # fmt: skip
