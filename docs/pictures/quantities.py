"""Quantities on axes: frequencies of the system, error indices over time, and verdicts."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import NamedTuple

from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.control.pointing import DEFAULT_DESIGN
from ps_fmu.disturbance.total import default_settings
from ps_fmu.disturbance.wheels import FORCE, TORQUE
from ps_fmu.mechanism.parameters import load
from ps_fmu.sensors.inertial import default_sensors
from ps_fmu.sensors.line_of_sight import DEFAULT_TRACKER
from ps_fmu.theory.loop import loop_at
from ps_fmu.theory.natural_modes import find_natural_modes

from .drawing import Drawing
from .signals import read_experiment, read_parameter

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
    isolators |= {name: read_parameter(name, "filters.highpass_frequency") for name in ("LineOfSight", "Instrument")}
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
