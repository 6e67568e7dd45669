"""One look for all figures: large type, colours that colour-blind readers can tell apart, engineering units.

Figures are made with matplotlib's object interface and its Agg canvas: no window system and no global state.
matplotlib is imported when the first figure is drawn, or before by :func:`prepare_drawing`.
"""

from __future__ import annotations

import io
import math
import re
from collections.abc import Callable, Iterable
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from threading import Lock, Thread
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ..files.plain import write_atomically

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.axis import Axis
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

# M. Okabe, K. Ito, Color Universal Design (2008).
PASSIVE = "#D55E00"
ACTIVE = "#0072B2"
AXES = ("#0072B2", "#D55E00", "#009E73")  # x, y, z
REFERENCE = "#555555"
FAULT = "#CC79A7"
COLOURS = {
    "passive": PASSIVE, "active": ACTIVE, "reference": REFERENCE, **dict(zip("xyz", AXES, strict=True)),
    "fault": FAULT, "amber": "#E69F00", "sky": "#56B4E9",
}  # fmt: skip
"""Colours by their names in charts; the page has a value of each for a light and for a dark page (page.css)."""

_DRAWING = Lock()
"""Settings and texts of matplotlib are those of all threads: one draws at a time."""
DOTS_PER_INCH = 150
COMPRESSION = 4  # of zlib; 6, the default, takes a fifth longer, for files 1 to 4 % smaller

STYLE: dict[Any, Any] = {
    "font.size": 13.0,
    "axes.titlesize": 14.0,
    "axes.grid": True,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#DDDDDD",
    "grid.linewidth": 0.8,
    "axes.axisbelow": True,
    "lines.linewidth": 1.6,
    "legend.frameon": False,
    "figure.titlesize": 15.0,
    "figure.titleweight": "bold",
    "agg.path.chunksize": 10000,
}


def prepare_drawing() -> Thread:
    """Import matplotlib in a thread, which is returned: FMUs that step meanwhile do not hold the lock.

    It takes 0.5 s.  If it cannot be imported, the first figure says so.
    """

    def load() -> None:
        with suppress(Exception):
            for module in ("figure", "backends.backend_agg"):
                import_module(f"matplotlib.{module}")

    thread = Thread(target=load, name="matplotlib", daemon=True)
    thread.start()
    return thread


def mark_picture(name: str) -> str:
    """What a picture says of its origin.  With its name: a copy of another name is of the person who made it."""
    return f"ps_fmu: {name}"


def draw(path: Path, width: float, height: float, paint: Callable[[Figure], None]) -> None:
    """Let ``paint`` draw on a figure of ``width`` x ``height`` inches and write it as PNG to ``path``."""
    from matplotlib import rc_context
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    with _DRAWING, rc_context(STYLE):
        figure = Figure(figsize=(width, height), dpi=DOTS_PER_INCH, layout="constrained")
        paint(figure)
        image = io.BytesIO()
        # No version and no date: the same data give the same bytes.
        canvas = FigureCanvasAgg(figure)
        _lay_out(figure)
        marks = {"Software": mark_picture(path.name)}
        canvas.print_png(image, metadata=marks, pil_kwargs={"compress_level": COMPRESSION})
    write_atomically(path, image.getvalue())


def _lay_out(figure: Figure) -> None:
    """Place the axes, so that nothing overlaps, and leave them there.

    Small ticks without labels take no room of their own, but most of the time: they are away meanwhile.
    """
    from matplotlib.ticker import NullLocator

    rulers = [axis for axes in figure.axes for axis in (axes.xaxis, axes.yaxis)]
    locators = [axis.get_minor_locator() for axis in rulers]
    for axis in rulers:
        axis.set_minor_locator(NullLocator())
    if (engine := figure.get_layout_engine()) is not None:
        engine.execute(figure)
    figure.set_layout_engine("none")
    for axis, locator in zip(rulers, locators, strict=True):
        axis.set_minor_locator(locator)


_RAISED = str.maketrans(
    "0123456789-", "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079\N{SUPERSCRIPT MINUS}"
)
_POWER = re.compile(r"\$\\mathdefault\{(.*)10\^\{(.*)\}\}\$")


def write_powers_plainly(axis: Axis) -> None:
    """Have the ticks of a logarithmic axis as plain text: matplotlib's own formulas take a quarter of all drawing."""
    from matplotlib.ticker import LogFormatterSciNotation

    class PlainPowers(LogFormatterSciNotation):
        def __call__(self, x: float, pos: int | None = None) -> str:
            found = _POWER.fullmatch(text := super().__call__(x, pos))
            if found is None:
                return text
            return found[1].replace(r"\times", "\N{MULTIPLICATION SIGN}") + "10" + found[2].translate(_RAISED)

    axis.set_major_formatter(PlainPowers())
    axis.set_minor_formatter(PlainPowers())


_PREFIXES = {-12: "p", -9: "n", -6: "\N{MICRO SIGN}", -3: "m", 0: "", 3: "k", 6: "M"}


def engineering(unit: str, magnitude: float) -> tuple[float, str]:
    """Factor and label of the engineering prefix that suits ``magnitude`` (in ``unit``).

    >>> engineering("m", 2.3e-3)
    (1000.0, 'mm')

    Units with a prefix of their own or with a power keep their own scale.
    """
    if unit not in {"m", "rad", "deg", "N", "N.m", "m/s", "rad/s", "m/s2", "rad/s2"} or not magnitude > 0.0:
        return 1.0, pretty(unit)
    exponent = min(max(3 * math.floor(math.log10(magnitude) / 3.0), -12), 6)
    return 10.0**-exponent, _PREFIXES[exponent] + pretty(unit)


def pretty(unit: str) -> str:
    """An FMI unit as a label: ``rad/s2`` with a raised 2, ``N.m`` with a space, nothing for ``1``."""
    if unit == "1":
        return ""
    return unit.replace(".", " ").translate(_RAISED)


def shade(axes: Axes, spans: Iterable[tuple[float, float]]) -> None:
    """Mark spans of time [s] in which a fault acts."""
    for first, last in spans:
        axes.axvspan(first, last, color=FAULT, alpha=0.25, lw=0, zorder=0.5)


def largest(values: Iterable[Array]) -> float:
    """Largest finite magnitude in the arrays; 0 if there is none."""
    found = 0.0
    for array in values:
        finite = np.abs(array[np.isfinite(array)])
        if finite.size:
            found = max(found, float(finite.max()))
    return found
