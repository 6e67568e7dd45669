"""What follows what: files from an instrument to its verdict, values within a communication step, a step of an FMU."""

from __future__ import annotations

import math

from .drawing import Drawing, Point

FILE, COMMAND = "pale-green", "pale-blue"


def draw_workflow() -> Drawing:
    """Files and commands from an instrument to verdict, budget, study and archive."""
    drawing = Drawing(
        "From an instrument to its verdict: files and commands",
        "ps-fmu parameters turns instrument.toml into instrument.ssv. ps-fmu run takes it, with requirements.toml, and "
        "writes results.nc, summary.json and report.html. ps-fmu judge judges results.nc. ps-fmu analyse budget finds "
        "where the error comes from, ps-fmu sweep runs many cases, ps-fmu ssp packs the system for other tools.",
        628.0,
    )
    values, required = 30.0, 130.0  # px: the vertical lines of instrument.ssv and requirements.toml
    for points, colour in (
        ([(180, 45), (240, 45)], "ink"),
        ([(450, 45), (510, 45)], "ink"),
        ([(600, 70), (600, 95), (values, 95), (values, 545), (240, 545)], "blue"),
        *(([(values, y), (x, y)], "blue") for x, y in ((240, 225), (240, 382), (70, 460))),
        ([(required, 170), (required, 367), (240, 367)], "purple"),
        *(([(required, y), (240, y)], "purple") for y in (210, 296)),
        ([(450, 217), (510, 217)], "ink"),
        ([(600, 255), (600, 296), (450, 296)], "ink"),
        ([(200, 460), (240, 460)], "ink"),
        *(([(450, y), (510, y)], "ink") for y in (375, 460, 545)),
    ):
        drawing.line(points, colour, 2.0, ends=">")
    for x, y, width, names in (
        (20, 45, 160, "instrument.toml"), (510, 45, 170, "instrument.ssv"), (70, 145, 160, "requirements.toml"),
        (510, 217, 170, "results.nc\nsummary.json\nreport.html"), (510, 375, 170, "budget.md\nbudget.json"),
        (70, 460, 130, "study.toml"), (510, 460, 170, "study.html\nstudy.parquet"), (510, 545, 170, "instrument.ssp"),
    ):  # fmt: skip
        _draw_file(drawing, x, y, width, names)
    for y, name, text in (
        (45, "ps-fmu parameters", "start values of all FMUs"),
        (217, "ps-fmu run isolation", "how the payload moves"),
        (296, "ps-fmu judge", "verdicts and margins"),
        (375, "ps-fmu analyse budget", "sources of the error"),
        (460, "ps-fmu sweep", "many cases"),
        (545, "ps-fmu ssp", "archive for other tools"),
    ):
        drawing.box(240, y - 26, 210, 52, COMMAND, "ink")
        drawing.text(345, y - 9, name, bold=True)
        drawing.text(345, y + 11, text, size=14)
    _draw_file(drawing, 20, 602, 34, "", 26)
    drawing.text(64, 602, "file", anchor="start")
    drawing.box(120, 588, 38, 26, COMMAND, "ink")
    drawing.text(168, 602, "command", anchor="start")
    for x, colour, text in ((264, "blue", "start values"), (430, "purple", "requirements")):
        drawing.line([(x, 602), (x + 36, 602)], colour, 2.0, ends=">")
        drawing.text(x + 44, 602, text, anchor="start")
    return drawing


def _draw_file(drawing: Drawing, x: float, y: float, width: float, names: str, height: float = 0.0) -> None:
    """A file, or files of one folder, as a sheet with a folded corner; y: of its middle."""
    lines, fold = names.count("\n") + 1, 12.0
    height = height or 26.0 + 20.0 * lines
    top, foot, right = y - height / 2, y + height / 2, x + width
    drawing.area([(x, top), (right - fold, top), (right, top + fold), (right, foot), (x, foot)], FILE, "ink")
    drawing.line([(right - fold, top), (right - fold, top + fold), (right, top + fold)], "ink", 1.2)
    drawing.text(x + width / 2, y - 9.5 * (lines - 1), names)


STEPS, LEFT, STEP = 6, 166.0, 84.0  # number, px, px


def draw_step_time() -> Drawing:
    """Values of two FMUs over time with the scheme of Jacobi: latched outputs, held inputs, the delay of the loop."""
    drawing = Drawing(
        "Time within communication steps: latched outputs, held inputs",
        "All FMUs make the same step h at once. The plant's output at the end of a step is the input that the "
        "controller holds during the next one. The controller's output at the end of that step is the input that the "
        "plant holds during the step after it. So the force begins one step after the output that caused it, and its "
        "mean lies one and a half steps after it.",
        590.0,
    )

    def place(step: float, lane: float, value: float = 0.0) -> Point:
        """px of a value, between -1 and 1, in a lane at a time in steps."""
        return LEFT + STEP * step, 95.0 + 108.0 * lane - 40.0 * value

    def signal(step: float) -> float:
        return math.sin(2.0 * math.pi * (step - 0.4) / 6.5)

    for k in range(STEPS + 1):
        drawing.line([(place(k, 0)[0], 42), (place(k, 0)[0], 540)], "grid", 1.0)
        drawing.text(place(k, 0)[0], 24, "t" if k == 0 else "t + h" if k == 1 else f"t + {k} h", "soft", size=14)
    for lane, text, colour in (
        (0, "output of\nthe plant", "orange"),
        (1, "input of the\ncontroller,\nheld", "orange"),
        (2, "output of\nthe controller", "blue"),
        (3, "input of\nthe plant,\nheld", "blue"),
    ):
        drawing.text(18, place(0, lane)[1] - 9, text, colour, anchor="start")
    drawing.line([place(0.05 * k, 0, signal(0.05 * k)) for k in range(20 * STEPS + 1)], "orange", 1.5)
    drawing.line([place(0.05 * k, 3, signal(0.05 * k)) for k in range(20 * STEPS + 1)], "soft", 1.5, dash="4 4")
    for lane, late, colour in ((1, 0, "orange"), (3, 1, "blue")):
        held = [place(k + late + end, lane, signal(k)) for k in range(STEPS - late) for end in (0, 1)]
        drawing.line(held, colour, 3.0)
    # What becomes of the output at t + h.
    seen = place(1, 0, signal(1)), place(1, 1, signal(1)), place(2, 2, signal(1)), place(2, 3, signal(1))
    drawing.line([(seen[0][0], seen[0][1] + 7), (seen[1][0], seen[1][1] - 3)], "ink", 1.8, ends=">")
    drawing.line([(seen[1][0] + 4, seen[1][1] + 6), (seen[2][0] - 5, seen[2][1] - 6)], "ink", 1.8, ends=">")
    drawing.line([(seen[2][0], seen[2][1] + 7), (seen[3][0], seen[3][1] - 3)], "ink", 1.8, ends=">")
    for lane, late, colour in ((0, 0, "orange"), (2, 1, "blue")):
        for k in range(STEPS + 1 - late):
            drawing.disc(place(k + late, lane, signal(k)), 5.0, colour)
    for last, y, text in (
        (2.0, 490.0, "1 step: the force begins"),
        (2.5, 520.0, "1.5 steps: the mean of the held force"),
    ):
        (first, _), (end, _) = place(1, 0), place(last, 0)
        drawing.line([(first, y), (end, y)], "green", 2.0, ends="<>")
        drawing.text(end + 10, y, text, "green", anchor="start", halo=True)
    drawing.disc((26, 568), 5.0, "ink")
    drawing.text(40, 568, "latched at the end of a step", anchor="start")
    drawing.line([(290, 568), (326, 568)], "ink", 3.0)
    drawing.text(336, 568, "held", anchor="start")
    drawing.line([(410, 568), (446, 568)], "soft", 1.5, dash="4 4")
    drawing.text(456, 568, "without delay", anchor="start")
    return drawing


def draw_step() -> Drawing:
    """What makes a step of an FMU: the launcher for most steps, Python for the rest."""
    drawing = Drawing(
        "How an FMU of ps_fmu makes a step",
        "The host calls the launcher. The launcher makes most steps by itself on the memory of the instance. It calls "
        "the slave in Python at the first step, at events, at another step size, and at the end of a table.",
        470.0,
    )
    memory = (
        "buffer [y | x | u | a | events | parameters | memory]\nmatrix M, table of rows, limits\n"
        "expected time and step size, is an event due?"
    )
    for x, y, width, height, fill, title, text in (
        (20, 40, 150, 150, "raised", "host", "fmi2SetReal\nfmi2DoStep\nfmi2GetReal"),
        (245, 40, 210, 150, "pale-blue", "launcher, compiled", "[y; x] = M [x; u; a; r]\nor the next row,\nlimits"),
        (530, 40, 150, 150, "pale-orange", "slave, Python", "event()\nstep_map(h)\nrows()"),
        (245, 300, 435, 130, "raised", "memory of the instance", memory),
    ):  # fmt: skip
        drawing.box(x, y, width, height, fill, "ink")
        drawing.text(x + width / 2, y + 24, title, bold=True)
        drawing.text(x + width / 2, y + 62, text, size=14)
    drawing.line([(170, 100), (245, 100)], "blue", 2.2, ends=">")
    drawing.text(207, 70, "each\ncall", "blue", size=14)
    drawing.line([(455, 100), (530, 100)], "orange", 2.2, ends=">")
    drawing.text(492, 84, "rarely", "orange", size=14)
    drawing.line([(300, 190), (300, 300)], "blue", 2.2, ends="<>")
    drawing.text(290, 226, "0.1 to 0.2 \N{MICRO SIGN}s per step,\nwithout Python's lock", "blue", anchor="end", size=14)
    drawing.line([(650, 190), (650, 300)], "orange", 2.2, ends="<>")
    rare = "first step, event,\nanother step size,\nend of a table,\nrefused values"
    drawing.text(640, 216, rare, "orange", anchor="end", size=14)
    return drawing
