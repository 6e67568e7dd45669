"""Signals between FMUs: the default system, and the instrument with sensors, voice coils and line-of-sight loop."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from .drawing import Drawing, Point

SYSTEMS = Path(__file__).resolve().parents[2] / "system"
SSV = "{http://ssp-standard.org/SSP1/SystemStructureParameterValues}"
SSD = "{http://ssp-standard.org/SSP1/SystemStructureDescription}"

Wires = dict[tuple[str, str], list[str]]

FORCE, MEASURED, SIGHT, DISTURBANCE = "blue", "orange", "green", "purple"
MEANING = {
    DISTURBANCE: "disturbance",
    FORCE: "commands and forces",
    MEASURED: "measured in the mechanism",
    SIGHT: "line of sight",
}


class Part(NamedTuple):
    """A component of the system as a box: left upper corner, size [px], what it does, and the colour of its ground."""

    x: float
    y: float
    width: float
    height: float
    text: str
    fill: str


class Route(NamedTuple):
    """How the signals of one component get to another: corners [px], start of the names [px], colour."""

    points: Sequence[Point]
    names: Point | None
    """None: a branch of signals that have their names already."""
    colour: str
    anchor: str = "start"


def read_wires(system: str) -> tuple[dict[str, str], Wires]:
    """Components of an .ssd file with their FMUs, and names of signals by the components that they join."""
    root = ET.parse(SYSTEMS / f"{system}.ssd").getroot()
    fmus = {part.get("name"): Path(part.get("source")).stem for part in root.iter(f"{SSD}Component")}
    wires: Wires = {}
    for wire in root.iter(f"{SSD}Connection"):
        signals = wires.setdefault((wire.get("startElement"), wire.get("endElement")), [])
        # Both FMUs call it the same, or the name at the end says where it comes in beside another.
        port = wire.get("endConnector" if wire.get("endConnector").startswith("added") else "startConnector")
        signal = re.sub(r"(\.\w+|_\d)$", "", port)
        if signal not in signals:
            signals.append(signal)
    return fmus, wires


def read_parameter(system: str, name: str) -> float:
    """The value of a parameter that an .ssd file sets."""
    (found,) = [p for p in ET.parse(SYSTEMS / f"{system}.ssd").iter(f"{SSV}Parameter") if p.get("name") == name]
    return float(found[0].get("value"))


def read_experiment(system: str) -> tuple[float, float]:
    """Communication step and end of an .ssd file, s."""
    root = ET.parse(SYSTEMS / f"{system}.ssd").getroot()
    (step,) = (part.get("baseStepSize") for part in root.iter() if part.get("baseStepSize"))
    return float(step), float(root.find(f"{SSD}DefaultExperiment").get("stopTime"))


def _draw_system(
    drawing: Drawing,
    fmus: Mapping[str, str],
    wires: Wires,
    parts: Mapping[str, Part],
    routes: Mapping[tuple[str, str], Route],
) -> None:
    """Boxes, and arrows with the names of their signals.  ValueError: the picture lacks something of the system."""
    if set(parts) != set(fmus) or set(routes) != set(wires):
        raise ValueError(f"not in the picture: {set(fmus) ^ set(parts)} {set(wires) ^ set(routes)}")
    for key, route in routes.items():
        drawing.line(route.points, route.colour, 2.2, ends=">")
        if route.names:
            drawing.text(*route.names, "\n".join(wires[key]), route.colour, anchor=route.anchor, size=14, halo=True)
    for name, part in parts.items():
        drawing.box(part.x, part.y, part.width, part.height, part.fill, "ink")
        middle, centre = part.x + part.width / 2, part.y + part.height / 2
        lines = part.text.count("\n") + 1
        drawing.text(middle, centre - 9.0 * lines, fmus[name], bold=True)
        drawing.text(middle, centre + 20.0 - 9.0 * lines, part.text, size=14)


def _draw_legend(drawing: Drawing, y: float) -> None:
    """What the colours mean, in two rows from y on."""
    for k, (colour, meaning) in enumerate(MEANING.items()):
        left, row = 20 + 320 * (k % 2), y + 26 * (k // 2)
        drawing.line([(left, row), (left + 34, row)], colour, 2.2, ends=">")
        drawing.text(left + 42, row, meaning, colour, anchor="start")


def draw_loop() -> Drawing:
    """The four FMUs of the default system."""
    drawing = Drawing(
        "The default system: four FMUs and the signals between them",
        "The disturbance source shakes the bus in the plant. The commander sets the lengths of the coarse legs. The "
        "isolator takes the acceleration of the base and the orientation, and answers with forces of the fine legs. "
        "Rotation of the payload and line of sight are the results that are judged.",
        455.0,
    )
    fmus, wires = read_wires("SystemStructure")
    parts = {
        "disturbance": Part(20, 30, 200, 66, "noise, wheels, sines,\nrecorded forces", "pale-purple"),
        "commander": Part(20, 150, 200, 66, "target orientation to\nlengths of coarse legs", "pale-blue"),
        "plant": Part(380, 30, 210, 186, "bus with arrays, six legs,\npayload, line of sight", "raised"),
        "isolator": Part(380, 310, 210, 66, "base acceleration to\nforces of fine legs", "pale-blue"),
    }
    routes = {
        ("disturbance", "plant"): Route([(220, 63), (380, 63)], (252, 34), DISTURBANCE),
        ("commander", "plant"): Route([(220, 183), (380, 183)], (236, 170), FORCE),
        ("isolator", "plant"): Route([(380, 343), (330, 343), (330, 205), (380, 205)], (322, 290), FORCE, "end"),
        ("plant", "isolator"): Route([(560, 216), (560, 310)], (552, 243), MEASURED, "end"),
    }
    _draw_system(drawing, fmus, wires, parts, routes)
    drawing.line([(590, 100), (686, 100)], SIGHT, 2.2, ends=">")
    drawing.text(598, 60, "payload_\nrotation", SIGHT, anchor="start", size=14)
    drawing.text(598, 118, "line_of_\nsight, los", SIGHT, anchor="start", size=14)
    _draw_legend(drawing, 410)
    return drawing


def draw_instrument_flow() -> Drawing:
    """The eight FMUs of FullInstrument.ssd."""
    drawing = Drawing(
        "The whole instrument: eight FMUs and the signals between them",
        "Accelerometers measure the base for the isolator, whose forces the voice coils make. A tracker measures the "
        "error of the line of sight for the controller of the loop, whose forces the voice coils add. Disturbance and "
        "commander act on the plant.",
        640.0,
    )
    fmus, wires = read_wires("FullInstrument")
    parts = {
        "commander": Part(20, 20, 190, 66, "target to lengths\nof coarse legs", "pale-blue"),
        "disturbance": Part(370, 20, 190, 66, "noise, wheels, sines,\nrecorded forces", "pale-purple"),
        "plant": Part(15, 145, 665, 62, "bus with arrays, six legs, payload, line of sight", "raised"),
        "coils": Part(15, 318, 170, 66, "currents, limits,\nend stops", "pale-blue"),
        "sensors": Part(250, 318, 190, 66, "accelerometers\non the base", "pale-orange"),
        "tracker": Part(500, 318, 180, 66, "error of the\nline of sight", "pale-green"),
        "isolator": Part(250, 478, 190, 66, "base acceleration to\nforces of fine legs", "pale-blue"),
        "pointing": Part(500, 478, 180, 66, "error to forces\nof fine legs", "pale-blue"),
    }
    routes = {
        ("commander", "plant"): Route([(115, 86), (115, 145)], (125, 112), FORCE),
        ("disturbance", "plant"): Route([(465, 86), (465, 145)], (475, 104), DISTURBANCE),
        ("plant", "sensors"): Route([(272, 207), (272, 318)], (280, 240), MEASURED),
        ("sensors", "isolator"): Route([(385, 384), (385, 478)], (377, 412), MEASURED, "end"),
        ("isolator", "coils"): Route([(250, 511), (110, 511), (110, 384)], (120, 497), FORCE),
        ("coils", "plant"): Route([(40, 318), (40, 207)], (48, 290), FORCE),
        ("plant", "coils"): Route([(127, 207), (127, 318)], (135, 240), MEASURED),
        ("plant", "tracker"): Route([(520, 207), (520, 318)], (528, 240), SIGHT),
        ("tracker", "pointing"): Route([(520, 384), (520, 478)], (528, 420), SIGHT),
        ("pointing", "coils"): Route([(585, 544), (585, 570), (50, 570), (50, 384)], (120, 557), FORCE),
        ("plant", "isolator"): Route([(476, 207), (476, 511), (440, 511)], (468, 456), MEASURED, "end"),
        ("plant", "pointing"): Route([(476, 511), (500, 511)], None, MEASURED),
    }
    _draw_system(drawing, fmus, wires, parts, routes)
    _draw_legend(drawing, 604)
    return drawing
