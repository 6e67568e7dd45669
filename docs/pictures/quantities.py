"""Quantities on axes: frequencies of the system, error indices over time, and verdicts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

import ps_fmu
from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.control.pointing import DEFAULT_DESIGN
from ps_fmu.disturbance.total import default_settings
from ps_fmu.disturbance.wheels import FORCE, TORQUE
from ps_fmu.mechanism.parameters import load
from ps_fmu.pointing import quantile, samples_needed
from ps_fmu.requirements.verdict import Answer, decide
from ps_fmu.sensors.inertial import default_sensors
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.natural_modes import find_natural_modes

from .drawing import Drawing, Point
from .signals import read_experiment, read_parameter

Array = NDArray[np.float64]

LOWEST, DECADE = 4e-5, 75.0  # Hz at x = 20 px; px


class Row(NamedTuple):
    """A row of the picture of frequencies."""

    text: str
    first: float
    """Hz; where the bar begins."""
    last: float
    colour: str
    marks: tuple[float, ...] = ()
    """Hz"""
    side: str = "in"
    """Where the text is: "left" or "right" of the bar, or "in" it."""


def draw_frequencies() -> Drawing:
    """What lies where between the slowest filter and the communication step."""
    groups = _list_groups()
    count = sum(len(rows) for rows in groups.values())
    height = 92.0 + 27.0 * count + 30.0 * len(groups)
    drawing = Drawing(
        "Frequencies of the default system, on one axis",
        "; ".join(f"{row.text}" for rows in groups.values() for row in rows),
        height,
    )
    for k in range(-4, 5):
        x = _place(10.0**k)
        drawing.line([(x, 40), (x, height - 24)], "grid", 1.0)
        drawing.text(x, 24, _write(10.0**k), "soft", size=13)
    y = 62.0
    for title, rows in groups.items():
        drawing.text(20, y, title, bold=True, anchor="start", halo=True)
        y += 28.0
        for row in rows:
            first, last = _place(row.first), _place(row.last)
            fill = "raised" if row.colour == "ink" else f"pale-{row.colour}"
            drawing.box(first, y - 10, max(last - first, 1.0), 20, fill, row.colour, 2)
            for mark in row.marks:
                drawing.line([(_place(mark), y - 10), (_place(mark), y + 10)], row.colour, 3.0)
            x, anchor = {
                "left": (first - 9, "end"), "right": (last + 9, "start"), "in": (first + 9, "start"),
            }[row.side]  # fmt: skip
            inside = row.side == "in"
            drawing.text(x, y, row.text, "ink" if inside else row.colour, anchor=anchor, size=14, halo=not inside)
            y += 27.0
        y += 2.0
    return drawing


def _list_groups() -> dict[str, list[Row]]:
    """The rows by what they belong to."""
    parameters = load()
    modes: dict[str, list[float]] = {}
    for mode in find_natural_modes(loop_at(parameters).model.dynamics):
        modes.setdefault(re.sub(r" \w$", "", mode.name), []).append(mode.frequency)
    noise, filters, step, end = parameters.noise.band, parameters.filters, *read_experiment("SystemStructure")
    wheel = default_settings(parameters).kinds["wheels"][0].initial_speed / (2.0 * math.pi)  # Hz
    orders = [*FORCE.orders, *TORQUE.orders]
    lines = min(orders) * wheel, max(orders) * wheel  # Hz
    loop, tracker = DEFAULT_DESIGN.crossover_frequency, 1.0 / DEFAULT_TRACKER.sample_time  # Hz
    sensors = default_sensors().accelerometer.bandwidth  # Hz
    driver = Coils.from_parameters(parameters).driver.bandwidth  # Hz
    isolators = {"SystemStructure": filters.highpass_frequency}  # Hz
    isolators |= {name: read_parameter(name, "filters.highpass_frequency") for name in ("FullInstrument", "Instrument")}
    return {
        "Disturbances": [
            Row(f"noise of the bus, {_span(noise)}", *noise, "purple", side="left"),
            Row(f"wheel at {60.0 * wheel:.0f} rpm, harmonics, {_span(lines)}", *lines, "purple", side="left"),
        ],
        "Resonances": [
            _list_modes("solar arrays", modes["bus mode"]),
            _list_modes("fine legs (suspension)", modes["fine legs"]),
            _list_modes("coarse rods", modes["coarse rods"], "left"),
            _list_modes("truss of the payload", modes["truss mode"], "left"),
        ],
        "Controllers and actuators": [
            *(
                Row(f"{name}.ssd: isolator from {highpass:g} Hz", highpass, filters.lowpass_stop_frequency, "blue")
                for name, highpass in isolators.items()
            ),
            Row(f"line-of-sight loop: to {loop:g} Hz", LOWEST, loop, "green"),
            Row(f"coarse servos: to {parameters.servo.frequency:g} Hz", LOWEST, parameters.servo.frequency, "blue"),
            Row(f"current loop of the voice coils: to {_write(driver)}", LOWEST, driver, "blue"),
        ],
        "Sensors": [
            Row(f"accelerometers: to {_write(sensors)}", LOWEST, sensors, "orange"),
            Row(f"tracker: samples at {_write(tracker)}", tracker, tracker, "green", (tracker,), "left"),
        ],
        "Simulation": [
            Row(f"a run of {end:g} s resolves {1.0 / end:g} Hz and above", 1.0 / end, 0.5 / step, "ink"),
            Row(f"communication step {1e3 * step:g} ms", 1.0 / step, 1.0 / step, "ink", (1.0 / step,), "left"),
        ],
    }


def _list_modes(text: str, frequencies: list[float], side: str = "right") -> Row:
    """A row of natural modes."""
    first, last = min(frequencies), max(frequencies)
    return Row(f"{text}, {_span((first, last))}", first, last, "ink", tuple(frequencies), side)


def _span(ends: Sequence[float]) -> str:
    """A band as text, two digits."""
    first, last = (float(f"{value:.2g}") for value in ends)
    return f"{_write(first)} to {_write(last)}"


def _place(frequency: float) -> float:
    """px of a frequency."""
    return 20.0 + DECADE * math.log10(frequency / LOWEST)


def _write(frequency: float) -> str:
    """A frequency as text: 0.01 Hz, 10 Hz, 1 kHz."""
    return f"{frequency / 1e3:g} kHz" if frequency >= 1e3 else f"{frequency:g} Hz"


SHOWN = 5.0, 13.0  # s of the run
WINDOW, SEPARATION, FIRST = 2.0, 3.0, 6.0  # s; the first window begins at the last


def draw_windows() -> Drawing:
    """What APE, MPE, RPE and PDE are, on the rotation of the payload about y in the default run without isolator."""
    time, error = _simulate()
    starts = FIRST, FIRST + SEPARATION
    inside = [(time >= start) & (time < start + WINDOW) for start in starts]
    means = [float(error[rows].mean()) for rows in inside]
    drawing = Drawing(
        "The indices APE, MPE, RPE and PDE on one error over time",
        "The absolute error APE is the error at a time. MPE is its mean over a window. RPE is the error minus the mean "
        f"of its window. PDE is the difference of the means of two windows. Here the window T is {WINDOW:g} s, the "
        f"separation D {SEPARATION:g} s, and the means are {means[0]:.1f} and {means[1]:.1f} urad.",
        566.0,
    )

    def place(t: float, e: float) -> Point:
        """px of an error e [urad] at the time t [s]."""
        return 58.0 + 618.0 * (t - SHOWN[0]) / (SHOWN[1] - SHOWN[0]), 190.0 - 19.0 * e

    for start in starts:
        (x, top), (end, foot) = place(start, 8.0), place(start + WINDOW, -8.0)
        drawing.box(x, top, end - x, foot - top, "pale-blue", radius=0)
    for e in (-8, -4, 0, 4, 8):
        (x, y), (end, _) = place(SHOWN[0], e), place(SHOWN[1], e)
        drawing.line([(x, y), (end, y)], "ink" if e == 0 else "grid", 1.2)
        drawing.text(x - 8, y, f"{e:g}".replace("-", "\N{MINUS SIGN}"), "soft", anchor="end", size=13)
    drawing.text(
        58, 18, "error, \N{MICRO SIGN}rad: rotation of the payload about y, passive", "soft", anchor="start", size=13
    )
    drawing.line([place(t, e) for t, e in zip(time, error, strict=True) if SHOWN[0] <= t <= SHOWN[1]], "soft", 1.4)
    for start, mean in zip(starts, means, strict=True):
        drawing.line([place(start, mean), place(start + WINDOW, mean)], "blue", 3.0)
    for start, mean, end in zip(starts, means, (starts[1], starts[0] + WINDOW), strict=True):
        drawing.line([place(start, mean), place(end, mean)], "green", 1.2, dash="4 4")
    # APE: at the largest error behind the windows.  RPE: late in the first window, where it is largest.
    largest = int(np.argmax(np.abs(error) * (time > starts[1] + WINDOW + 0.5)))
    furthest = int(np.argmax(np.abs(error - means[0]) * inside[0] * (time > starts[0] + 0.5 * WINDOW)))
    between = 0.5 * (starts[0] + WINDOW + starts[1])
    for name, at, (first, last), colour, side in (
        ("APE", time[largest], (0.0, error[largest]), "purple", -1),
        ("MPE", starts[0] + 0.35, (0.0, means[0]), "blue", 1),
        ("MPE", starts[1] + 0.35, (0.0, means[1]), "blue", 1),
        ("RPE", time[furthest], (means[0], error[furthest]), "orange", -1),
        ("PDE", between, means, "green", 1),
    ):
        drawing.line([place(at, first), place(at, last)], colour, 2.4, ends="<>" if name == "PDE" else ">")
        x, y = place(at, last + 0.8 if name == "RPE" else 0.5 * (first + last))
        drawing.text(x + 8 * side, y, name, colour, anchor="start" if side > 0 else "end", bold=True, halo=True)
    _mark_length(drawing, place(starts[0], -8.0), place(starts[0] + WINDOW, -8.0), 36, f"window T = {WINDOW:g} s")
    _mark_length(drawing, place(starts[0], -8.0), place(starts[1], -8.0), 74, f"separation D = {SEPARATION:g} s")
    for t in range(int(SHOWN[0]), int(SHOWN[1]) + 1):
        drawing.text(place(t, 0)[0], 190.0 + 19.0 * 8 + 16, f"{t} s", "soft", size=13, halo=True)
    y = 470.0
    for name, meaning, colour in (
        ("APE", "error at one time", "purple"),
        ("MPE", "mean of the error over a window T", "blue"),
        ("RPE", "error minus the mean of its window", "orange"),
        ("PDE", "difference of the means of two windows, D from start to start", "green"),
    ):
        drawing.text(58, y, name, colour, anchor="start", bold=True)
        drawing.text(106, y, meaning, anchor="start")
        y += 25.0
    return drawing


def _mark_length(drawing: Drawing, first: Point, last: Point, below: float, text: str) -> None:
    """A dimension between two points, ``below`` px under them."""
    for x, y in (first, last):
        drawing.line([(x, y + 25), (x, y + below + 4)], "soft", 1.0)
    y = first[1] + below
    drawing.line([(first[0], y), (last[0], y)], "ink", 1.5, ends="<>")
    drawing.text(0.5 * (first[0] + last[0]), y + 15, text)


def _simulate() -> tuple[Array, Array]:
    """Times [s] and rotation of the payload about y [urad] in the default run without isolator."""
    rows = ps_fmu.simulate(
        "isolation", cases=["passive"], duration=SHOWN[1], storage_step=0.02, observe="plant.payload_rotation",
        progress=False,
    ).passive  # fmt: skip
    return rows.time.values, 1e6 * rows["payload_rotation"].sel(axis="y").values


LIMIT, PROBABILITY, CONFIDENCE = 0.5, 0.95, 0.9  # urad
CASES = {  # scale of an error [urad], number of independent samples, reason of the verdict
    "bound below the limit": (0.15, 100),
    "limit within the interval": (0.235, 100),
    "interval above the limit": (0.36, 100),
    "{samples} samples, {needed} needed": (0.17, 30),
}


def draw_verdict() -> Drawing:
    """Value, interval, bound, limit and margin of four records, with the verdicts on them."""
    needed = samples_needed(PROBABILITY, CONFIDENCE)
    judged = []
    for k, (reason, (scale, samples)) in enumerate(CASES.items()):
        values = np.abs(np.random.default_rng(k).normal(scale=scale, size=samples))
        stated = quantile(values, PROBABILITY, CONFIDENCE)
        judged.append((decide(stated, LIMIT), stated, reason.format(samples=samples, needed=needed)))
    drawing = Drawing(
        "The four verdicts: value, interval, bound, limit and margin",
        "; ".join(f"{answer}: {reason}" for answer, _, reason in judged),
        470.0,
    )

    def place(value: float) -> float:
        """px of a value [urad]."""
        return 40.0 + 620.0 * value / 0.9

    for tick in (0.0, 0.2, 0.4, 0.6, 0.8):
        drawing.line([(place(tick), 40), (place(tick), 400)], "grid", 1.0)
        drawing.text(place(tick), 414, f"{tick:g} \N{MICRO SIGN}rad", "soft", size=13)
    drawing.text(place(LIMIT), 22, f"limit {LIMIT:g} \N{MICRO SIGN}rad", "purple", bold=True)
    for k, (answer, stated, reason) in enumerate(judged):
        y = 104.0 + 85.0 * k
        drawing.text(40, y - 40, answer.value, anchor="start", bold=True, halo=True)
        drawing.text(40 + 10 * len(answer.value) + 14, y - 40, reason, "soft", anchor="start", halo=True)
        open_end = not math.isfinite(stated.upper)
        last = place(0.9) if open_end else place(stated.upper)
        first = place(max(stated.lower, 0.0))
        drawing.box(first, y - 12, last - first, 24, "pale-blue", "" if open_end else "blue", 2)
        drawing.disc((place(stated.value), y), 6.0, "ink")
        if math.isfinite(stated.bound):
            drawing.line([(place(stated.bound), y - 17), (place(stated.bound), y + 17)], "orange", 3.5)
        if answer is Answer.MET:
            drawing.line([(place(stated.bound), y), (place(LIMIT), y)], "green", 2.0, ends="<>")
            margin = 100.0 * (1.0 - stated.bound / LIMIT)
            middle = 0.5 * (place(stated.bound) + place(LIMIT))
            drawing.text(middle, y + 18, f"margin {margin:.0f} %", "green", halo=True)
    drawing.line([(place(LIMIT), 36), (place(LIMIT), 400)], "purple", 2.5, dash="7 5")
    drawing.disc((46, 446), 6.0, "ink")
    drawing.text(60, 446, "value: best estimate", anchor="start")
    drawing.box(234, 435, 30, 22, "pale-blue", "blue", 2)
    drawing.text(272, 446, "interval of the value", anchor="start")
    drawing.line([(456, 433), (456, 459)], "orange", 3.5)
    drawing.text(466, 446, f"bound, {100.0 * CONFIDENCE:g} % confidence", anchor="start")
    return drawing
