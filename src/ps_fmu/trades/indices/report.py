"""Pointing indices at four orientations, passive and active: the FMUs beside the closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from ...analyses.result import AnalysisResult, paint_pictures
from ...analyses.system import load_own_systems
from ...analyses.table import SYSTEM, AnalysisOptions
from ...cosim import System
from ...pointing import PointingIndex
from ...product.files import find_product
from ...results.style import AXES, REFERENCE
from ...results.tables import Table
from .comparison import (
    APART,
    JOINT,
    ORIENTATIONS,
    SIGNALS,
    Comparison,
    Orientations,
    find_settling,
    list_cases,
    list_indices,
    measure,
    read_orientation,
    share_held,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

DURATION = 400.0  # s, of each run after the settling
MICRO = 1e6  # urad in a rad
CAPTION = (
    "RMS of each index on the FMUs over closed form, with intervals of 95 % (thick) and of all together (thin)."
)


def analyse(
    options: AnalysisOptions,
    duration: float = DURATION,
    indices: Mapping[str, PointingIndex] | None = None,
    points: int = 4000,
) -> AnalysisResult:
    """Run the FMUs for ``duration``, s, in each case, and compare the indices, by default those of the closed form.

    The default system at the orientations of Table 2 of the paper; another one, or with other start values, at the
    target of its commander.  ``points``: frequencies of the closed form, see :class:`.comparison.ClosedForm`.
    """
    indices = list_indices() if indices is None else indices
    (system,) = load_own_systems(options)
    default = options.system.resolve() == (find_product().system / SYSTEM).resolve()
    own = options.parameters or options.replace or not default
    orientations = read_orientation(system) if own else ORIENTATIONS
    cases = list_cases(orientations)
    with tqdm(total=len(cases), unit="run", desc="indices", disable=not options.progress) as bar:
        compared = measure(system, indices, duration, options.seed, points, bar.update, orientations)
    return AnalysisResult(
        name="indices",
        title="Pointing indices: the FMUs beside the closed form",
        text=describe(compared, system, orientations, duration),
        tables=[_make_summary(compared, orientations), *(_make_table(compared, *case) for case in cases)],
        pictures=paint_pictures(
            options.output, "indices", ("intervals", CAPTION, (16.0, 15.0), paint_comparisons, compared, orientations)
        ),
        data=_make_entry(compared, duration),
    )


def describe(
    compared: Sequence[Comparison], system: System, orientations: Orientations, duration: float
) -> list[str]:
    """What was compared, and what came of it."""
    outside = [each for each in compared if not each.holds]
    far = max(compared, key=lambda each: abs(each.stated.value / each.expected - 1.0))
    worst = "; ".join(_name(each) for each in outside[:5]) or "none"
    return [
        f"{system.path.stem} with its Gaussian disturbance, {duration:g} s at each orientation after "
        f"{find_settling(system):.3g} s of settling, without and with the isolator. Rotation of the payload and of its "
        f"line of sight. The windows of the drift error (PDE) lie {APART} windows apart from start to start.",
        "Closed form: plant, isolator, holds and the exchange of a step as a discrete linear system, exactly; the "
        "density of the noise as its generator makes it; the weights of sampled data. Nothing is fitted. The noise has "
        "sharp band edges, hence no state space of finite order: the integral runs over frequencies.",
        "Interval: that which ps_fmu.pointing.windows_rms states for the record, from chi-square with the effective "
        f"number of samples; at {100.0 * JOINT:g} % for all {len(compared)} comparisons together (Bonferroni).",
        f"Intervals that do not hold the closed form: {len(outside)} of {len(compared)} ({worst}). Of the intervals of "
        f"95 % each, {100.0 * share_held(compared):.1f} % hold it; they are not independent of each other. The largest "
        f"difference is {100.0 * (far.stated.value / far.expected - 1.0):+.1f} % ({_name(far)}), with "
        f"{far.stated.independent:.0f} independent samples. With the number of independent samples in closed form, by "
        f"the spectrum, {sum(not each.known_holds for each in compared)} intervals do not hold it.",
    ]


def _name(each: Comparison) -> str:
    return f"{each.index} of {each.signal}, {each.orientation}, {_mode(each.active)}"


def _mode(active: bool) -> str:
    return "active" if active else "passive"


def _make_summary(compared: Sequence[Comparison], orientations: Orientations) -> Table:
    rows = []
    for name, active in list_cases(orientations):
        own = [each for each in compared if (each.orientation, each.active) == (name, active)]
        ratios = np.array([each.stated.value / each.expected - 1.0 for each in own])
        angles = "({:g}, {:g}, {:g})".format(*orientations[name])
        rows.append(
            (
                angles, _mode(active), str(sum(each.holds for each in own)), str(len(own)),
                f"{100.0 * share_held(own):.1f}", f"{100.0 * ratios.min():+.1f}", f"{100.0 * ratios.max():+.1f}",
            )
        )  # fmt: skip
    header = (
        "roll, pitch, yaw (deg)", "isolator", "hold", "of", "95 % intervals hold (%)", "lowest (%)", "highest (%)",
    )  # fmt: skip
    return Table("Intervals that hold the closed form, and differences of the RMS from it", header, rows)


def _make_table(compared: Sequence[Comparison], orientation: str, active: bool) -> Table:
    """One case: the closed form, the estimate and its interval of 95 % for x, y and z of the payload."""
    shown = SIGNALS[:3]
    found = {
        (each.index, each.signal): each for each in compared if (each.orientation, each.active) == (orientation, active)
    }
    rows = []
    for index in dict.fromkeys(index for index, _ in found):
        row = [index]
        for signal in shown:
            each = found[index, signal]
            low, high = (_micro(value) for value in (each.usual.lower, each.usual.upper))
            row += [_micro(each.expected), f"{_micro(each.usual.value)} ({low} to {high})"]
        rows.append(tuple(row))
    header = ("index", *(text for axis in "xyz" for text in (f"{axis}, closed form", f"{axis}, FMUs (95 %)")))
    return Table(f"Payload rotation, RMS (urad): {orientation}, {_mode(active)}", header, rows)


def _micro(value: float) -> str:
    return f"{MICRO * value:.4g}"


def _make_entry(compared: Sequence[Comparison], duration: float) -> dict[str, object]:
    return {
        "duration_s": duration,
        "joint_probability": JOINT,
        "comparisons": [
            {
                "orientation": each.orientation, "isolator": each.active, "index": each.index, "signal": each.signal,
                "closed_form_rad": each.expected, "fmus_rad": each.stated.value,
                "independent_samples": each.stated.independent, "interval_95_rad": [each.usual.lower, each.usual.upper],
                "interval_joint_rad": [each.stated.lower, each.stated.upper], "holds": each.holds,
                "independent_samples_closed_form": each.known.independent,
                "interval_joint_closed_form_rad": [each.known.lower, each.known.upper],
                "known_holds": each.known_holds,
            }
            for each in compared
        ],
    }  # fmt: skip


_SHOWN = dict(zip(SIGNALS[:3], zip(AXES, (-0.22, 0.0, 0.22), strict=True), strict=True))  # colour and place in a row

_RANGE = (0.6, 1.6)  # of the ratio: intervals of slow indices go on beyond it


def paint_comparisons(figure: Figure, compared: Sequence[Comparison], orientations: Orientations) -> None:
    """A panel for each orientation, passive above and active below; x, y, z of the payload side by side."""
    names = list(dict.fromkeys(each.index for each in compared))
    panels = figure.subplots(2, len(orientations), sharex=True, sharey=True, squeeze=False)
    for row, active in zip(panels, (False, True), strict=True):
        for axes, (name, angles) in zip(row, orientations.items(), strict=True):
            own = [each for each in compared if (each.orientation, each.active) == (name, active)]
            _paint(axes, own, names)
            mode = "active" if active else "passive"
            axes.set_title("{}: ({:g}, {:g}, {:g})\N{DEGREE SIGN}".format(mode, *angles))
    panels[0, 0].set_yticks(np.arange(len(names)), names)
    panels[0, 0].invert_yaxis()
    panels[0, 0].set_xlim(*_RANGE)
    for axes in panels[1]:
        axes.set_xlabel("RMS on the FMUs over closed form")
    handles = panels[0, 0].get_legend_handles_labels()
    figure.legend(*handles, loc="outside lower center", ncols=len(_SHOWN), title="payload rotation about")
    figure.suptitle("Pointing indices: FMUs over closed form, intervals of 95 % (thick) and of all together (thin)")


def _paint(axes: Axes, own: Sequence[Comparison], names: Sequence[str]) -> None:
    axes.axvline(1.0, color=REFERENCE, lw=1.2)
    for signal, (colour, shift) in _SHOWN.items():
        found = {each.index: each for each in own if each.signal == signal}
        place = np.arange(len(names)) + shift
        value, low, high, lowest, highest = np.array(
            [
                np.array([e.stated.value, e.usual.lower, e.usual.upper, e.stated.lower, e.stated.upper]) / e.expected
                for e in (found[name] for name in names)
            ]
        ).T
        axes.hlines(place, lowest, highest, color=colour, lw=0.8)
        axes.hlines(place, low, high, color=colour, lw=2.6)
        axes.plot(value, place, "o", color=colour, ms=4, label=signal.rpartition(".")[2])
