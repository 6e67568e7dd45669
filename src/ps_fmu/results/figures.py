"""Figures as PNG files, painted from what the page of a report shows: charts, clouds of points, waterfalls.

SI data in, engineering units on the axes.  Passive is orange, active blue throughout.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from threading import Thread
from typing import TYPE_CHECKING, Any, Self

import msgspec
import numpy as np
from numpy.typing import NDArray

from ..child_processes import collect_rarely, end_group
from .page.content import Axis, Chart, ChartGroup, CloudGroup, Curve, Exploration, Spans, Still
from .report import Picture
from .style import COLOURS, REFERENCE, draw, engineering, largest, prepare_drawing, pretty, write_powers_plainly
from .waterfall import draw_waterfall

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

MOST_SPANS = 1500
"""Of a curve over the width of a chart; where it has more values it is drawn as the extremes of each span."""
_DECADES = 30.0  # from the first value of a logarithmic axis to the last: powers of ten are ticks enough
_TICKS, _HEADING = 1.2, 0.45  # inches left of and above a chart
_DRAWN: Mapping[str, dict[str, Any]] = {
    "line": {"lw": 1.2}, "dashed": {"lw": 1.2, "ls": "--"}, "dotted": {"lw": 1.2, "ls": ":"},
    "steps": {"lw": 1.2, "drawstyle": "steps-post"}, "dots": {"ls": "", "marker": ".", "ms": 4.0},
}  # fmt: skip


def draw_exploration(explored: Exploration, folder: Path, first: int = 0, stride: int = 1) -> list[Picture]:
    """Draw the stills of all groups into a folder; the pictures, with their captions.  Raises OSError.

    ``first``, ``stride``: which of the stills.
    """
    stills = _list_stills(explored)[first::stride]
    for file, _, paint in stills:
        paint(folder / file)
    return [Picture(folder / file, caption) for file, caption, _ in stills]


def _list_stills(explored: Exploration) -> list[tuple[str, str, Callable[[Path], None]]]:
    """The name of each file, its caption, and what draws it."""
    return [
        *((one.file, one.caption, partial(draw_waterfall, shown=one)) for one in explored.waterfalls),
        *(
            (still.file, still.caption or group.caption, partial(draw_charts, group=group, still=still))
            for group in explored.charts
            for still in group.stills
        ),
        *((one.file, one.caption, partial(draw_clouds, group=one)) for one in explored.clouds if one.file),
    ]


class Painter:
    """A process of its own that draws figures while this one does something else.

    It begins by importing matplotlib, which takes 0.5 s.  What it cannot draw, or where it cannot be started, is drawn
    here.
    """

    def __init__(self) -> None:
        command = [sys.executable, "-I", "-c", f"from {__name__} import draw_what_comes; draw_what_comes()"]
        none = subprocess.DEVNULL
        self._process: subprocess.Popen[bytes] | None = None
        with suppress(OSError):
            self._process = subprocess.Popen(
                command, stdin=subprocess.PIPE, stdout=none, stderr=none, start_new_session=True
            )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End the process, and what it has forked."""
        if self._process is not None:
            end_group(self._process.pid)
            self._process.wait()

    def begin(self, explored: Exploration, folder: Path) -> Callable[[], list[Picture]]:
        """Have the stills of all groups drawn into a folder.

        What waits until they are drawn, and returns the pictures with their captions; that raises OSError.
        """
        shown, process = replace(explored, mechanism=None, cases=None), self._process
        if process is None:
            return partial(draw_exploration, explored, folder)
        given = msgspec.msgpack.encode((str(folder.absolute()), shown), enc_hook=_write_array)
        thread = Thread(target=process.communicate, args=(given,), daemon=True)  # it may not listen yet
        thread.start()

        def wait() -> list[Picture]:
            thread.join()
            if process.returncode:
                return draw_exploration(explored, folder)
            return [Picture(folder / file, caption) for file, caption, _ in _list_stills(explored)]

        return wait


def draw_what_comes() -> None:
    """Draw what a :class:`Painter` asks for, half of it in a fork where there are any; the program of its process."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # who has asked for it ends it
    with collect_rarely():
        prepare_drawing().join()
        if given := sys.stdin.buffer.read():
            folder, explored = msgspec.msgpack.decode(given, type=tuple[str, Exploration], dec_hook=_read_array)
            _draw_in_two(explored, Path(folder))


def _draw_in_two(explored: Exploration, folder: Path) -> None:
    if sys.platform == "win32":
        draw_exploration(explored, folder)
        return
    fork = os.fork()
    if not fork:
        code = 1
        try:
            draw_exploration(explored, folder, 1, 2)
            code = 0
        finally:
            os._exit(code)
    draw_exploration(explored, folder, 0, 2)
    if os.waitpid(fork, 0)[1]:
        sys.exit(1)


def _write_array(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return value.dtype.str, value.shape, value.tobytes()
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"no part of a figure: {type(value).__name__}")


def _read_array(_: object, value: Any) -> Any:
    dtype, shape, content = value
    return np.frombuffer(content, dtype).reshape(shape)


def draw_charts(path: Path, group: ChartGroup, still: Still | None = None) -> None:
    """Draw the charts of a group as a PNG file: below one another, or in columns as on the page.

    Parameters
    ----------
    group: the charts, and what is marked in each of them.
    still: what of the group is shown; None: all of it.
    """
    still = still or Still(path.name)
    charts = [_choose(chart, still.curves) for chart in group.charts[: still.charts]]
    columns = group.columns
    if still.enlarged:
        pairs = [
            (chart, replace(_choose(chart, [still.enlarged]), title=f"{chart.title}, {still.enlarged} enlarged"))
            for chart in charts
        ]
        charts, columns = [chart for pair in pairs for chart in pair], 2
    shown = replace(group, title=still.title or group.title, charts=charts)
    rows = -(-len(charts) // columns)
    size = {1: 11.0, 2: 12.0, 3: 15.0}[columns], 1.2 + (4.4 if rows == 1 else 3.0 if columns == 3 else 2.5) * rows
    draw(path, *size, lambda figure: paint_charts(figure, shown, columns))


def paint_charts(figure: Figure, group: ChartGroup, columns: int = 1) -> None:
    """Paint charts in so many columns, with one legend where all have the same curves, else one beside each.

    Margins are set by hand, in inches: to find them by the sizes of all texts takes as long as all the drawing.
    """
    figure.set_layout_engine("none")
    marked = [*(spans.label for spans in group.shaded if spans.spans), *(text for text, _ in group.marked)]
    names = [list(dict.fromkeys([*(curve.label for curve in chart.curves), *marked])) for chart in group.charts]
    longest = max(len(name) for each in names for name in each)
    common = columns > 1 or all(each == names[0] for each in names)
    width, height = figure.get_size_inches()
    rows = -(-len(group.charts) // columns)
    beside = max(1, min(6, int(8.5 * width) // (7 + longest)))  # entries of the common legend
    foot = 0.75 + (0.3 * -(-len({name for each in names for name in each}) // beside) if common else 0.0)
    right = 0.25 if common else 0.6 + 0.085 * longest
    place = {
        "left": _TICKS / width, "right": 1.0 - right / width, "bottom": foot / height, "top": 1.0 - 0.75 / height,
        "wspace": _TICKS * columns / (width - right - _TICKS * columns),
        "hspace": _HEADING * rows / (height - foot - 0.75 - _HEADING * (rows - 1)),
    }  # fmt: skip
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False, gridspec_kw=place)
    legends = [_paint_chart(axes, chart, group) for axes, chart in zip(grid.flat, group.charts, strict=True)]
    if common:
        legend = {text: handle for legend in legends for text, handle in legend.items()}
        shown = figure.legend(legend.values(), legend.keys(), loc="lower center", ncols=beside)
        for line in shown.get_lines():
            line.set_linewidth(3.0)
    else:
        for axes, legend in zip(grid.flat, legends, strict=True):
            axes.legend(legend.values(), legend.keys(), loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=9.0)
    for axes in grid[-1]:
        axes.set_xlabel(f"{group.axis.label} ({pretty(group.axis.unit)})")
    figure.suptitle(group.title, wrap=True, y=1.0 - 0.12 / height)


def draw_clouds(path: Path, group: CloudGroup) -> None:
    """Draw all clouds in one plane as a PNG file, and the last one alone, enlarged."""

    def paint(figure: Figure) -> None:
        for axes, clouds in zip(figure.subplots(1, 2), (group.clouds, group.clouds[-1:]), strict=True):
            factor, unit = engineering(group.unit, largest([cloud.hull for cloud in clouds]))
            for cloud in clouds:
                corners = factor * np.concatenate((cloud.hull, cloud.hull[:1]))
                colour = COLOURS[cloud.colour]
                axes.plot(*factor * cloud.points.T, ".", color=colour, ms=2.5, alpha=0.5, mew=0.0)
                axes.plot(*corners.T, color=colour, label=cloud.label)
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_xlabel(f"x ({unit})")
            axes.set_ylabel(f"y ({unit})")
            axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.12))
        figure.suptitle(group.title, wrap=True)

    draw(path, 12.0, 7.2, paint)


def draw_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "") -> None:
    """Draw a table as a PNG file: ``rows`` of text under a ``header``."""
    width = sum(2 + max(len(line[column]) for line in [header, *rows]) for column in range(len(header)))

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axis("off")
        table = axes.table([list(row) for row in rows], colLabels=list(header), loc="center", edges="horizontal")
        table.auto_set_font_size(False)
        table.set_fontsize(13.0)
        table.auto_set_column_width(list(range(len(header))))
        table.scale(1.0, 1.6)
        figure.suptitle(title)

    draw(path, 0.6 + 0.115 * width, 1.0 + 0.36 * len(rows), paint)


def _choose(chart: Chart, labels: Sequence[str]) -> Chart:
    """The chart with the curves of these labels; with all for none."""
    return replace(chart, curves=[curve for curve in chart.curves if curve.label in labels]) if labels else chart


def _paint_chart(axes: Axes, chart: Chart, group: ChartGroup) -> dict[str, Artist]:
    """Paint a chart with what is marked in it; what a legend names, by its text."""
    most = largest(each for curve in chart.curves for each in curve.ends)
    factor, unit = engineering(chart.unit, 0.0 if chart.logarithmic else most)
    legend = {curve.label: _paint_curve(axes, chart, curve, group.axis, factor) for curve in chart.curves}
    for shaded in group.shaded:
        colour = COLOURS[shaded.colour]
        for first, last in shaded.spans:
            legend[shaded.label] = axes.axvspan(first, last, color=colour, alpha=shaded.opacity, lw=0, zorder=0.5)
    for text, at in group.marked:
        legend[text] = axes.axvline(at, color=REFERENCE, lw=1.2, ls=":")
    if group.axis.logarithmic:
        axes.set_xscale("log")
    if chart.logarithmic and most > 0.0:
        axes.set_yscale("log")
    axes.margins(x=0.0)
    axes.tick_params(labelsize=11.0)
    for ruler, (first, last) in ((axes.xaxis, axes.get_xlim()), (axes.yaxis, axes.get_ylim())):
        if ruler.get_scale() == "log":
            write_powers_plainly(ruler)
        if ruler.get_scale() == "log" and last > _DECADES * first:
            ruler.minorticks_off()  # they take a third of the time, and say little there
    axes.set_title(chart.title.replace("$", r"\$"), loc="left", fontsize=11.5)
    axes.set_ylabel(unit)
    return legend


def _paint_curve(axes: Axes, chart: Chart, curve: Curve, axis: Axis, factor: float) -> Artist:
    """Paint a line, or a band between the extremes of each span; returns it."""
    low, high = (factor * np.asarray(values, dtype=float) for values in curve.ends)
    if chart.logarithmic:  # zero has no place there: a gap instead
        low, high = (np.where(values > 0.0, values, np.nan) for values in (low, high))
    colour, drawn = COLOURS[curve.colour], _DRAWN[curve.drawn]
    if curve.drawn == "dots":
        return axes.plot(axis.values, low, color=colour, label=curve.label, **drawn)[0]
    at, low, high = _thin(axis, low, high)
    if curve.drawn != "line" or np.array_equal(low, high, equal_nan=True):
        return axes.plot(at, low, color=colour, label=curve.label, **drawn)[0]
    # The edge keeps a band visible where it is thinner than a pixel.
    return axes.fill_between(at, low, high, color=colour, lw=0.8)


def _thin(axis: Axis, low: Array, high: Array) -> tuple[Array, Array, Array]:
    """Axis values, lowest and highest value of each of at most :data:`MOST_SPANS` spans."""
    at = np.asarray(axis.values)
    if len(at) <= MOST_SPANS:
        return at, low, high
    place = np.log(at) if axis.logarithmic else at
    spans = ((place - place[0]) * (MOST_SPANS / (place[-1] - place[0]))).astype(int)
    starts = np.flatnonzero(np.diff(spans, prepend=-1))
    return at[starts], np.fmin.reduceat(low, starts), np.fmax.reduceat(high, starts)


# --- A first look at any run: all columns over time, those of one unit in one panel -----------------------------------

MOST_PANELS = 8
MOST_LINES = 6
_COLOURS = (*"xyz", "fault", "amber", "sky")


@dataclass(frozen=True)
class Line:
    """A column: its name, its unit ("1": none), whether it is held between its values, and what reads them (rows,).

    Only those that are drawn are read: to read all of thousands of columns of a file takes minutes.
    """

    name: str
    unit: str
    held: bool
    read: Callable[[], Array]


def draw_quick_plot(
    path: Path,
    time: Array,
    lines: Sequence[Line],
    *,
    title: str,
    shaded: Sequence[tuple[float, float]] = (),
) -> str:
    """Draw lines over ``time`` [s] into a PNG file; what is left out, "" for nothing.  ``shaded``: a fault acts [s].

    Each unit has a panel of its own, at most :data:`MOST_LINES` lines in each; values without a unit that are held
    (Integers, Booleans) have one, too.
    """
    panels: list[list[Line]] = []
    open_panels: dict[tuple[str, bool], list[Line]] = {}
    for line in lines:
        key = line.unit, line.held
        if key not in open_panels or len(open_panels[key]) == MOST_LINES:
            open_panels[key] = []
            panels.append(open_panels[key])
        open_panels[key].append(line)
    charts = [Chart("", "1" if panel[0].held else panel[0].unit, _make_curves(panel)) for panel in panels[:MOST_PANELS]]
    faults = [Spans("a fault acts", shaded, "fault", 0.25)] if shaded else []
    draw_charts(path, ChartGroup(title, "", Axis("time", "s", time), charts, shaded=faults))
    left = sum(map(len, panels[MOST_PANELS:]))
    return f"{left} of {len(lines)} columns are not in the plot: choose some with --observe" if left else ""


def _make_curves(panel: Sequence[Line]) -> list[Curve]:
    return [
        Curve(_shorten(line.name), colour, line.read(), drawn="steps" if line.held else "line")
        for line, colour in zip(panel, _COLOURS, strict=False)
    ]


def _shorten(name: str) -> str:
    return name if len(name) <= 36 else f"...{name[-33:]}"
