"""The figures of the reports: each function takes data and the path of the PNG that it writes.

SI data in, engineering units on the axes.  Passive is orange, active blue throughout.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ..pointing.spectra import cumulative_rms, log_bands
from .observers.envelope import Envelope
from .observers.scatter import Scatter
from .style import ACTIVE, AXES, PASSIVE, REFERENCE, draw, engineering, label, largest, pretty, shade

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

DECADES = 16


def draw_time_histories(
    path: Path,
    passive: Envelope,
    active: Envelope,
    *,
    title: str = "",
    shaded: Sequence[tuple[float, float]] = (),
) -> None:
    """Passive and active signals over time, a row per signal; on the right the active one enlarged.

    ``shaded``: when a fault acts [s].
    """
    if passive.names != active.names:
        raise ValueError(f"passive and active show different signals: {passive.names} and {active.names}")
    count = len(passive.names)

    def paint(figure: Figure) -> None:
        grid = figure.subplots(count, 2, sharex=True, squeeze=False)
        for row, (both, alone) in enumerate(grid):
            factor, unit = engineering(passive.units[row], largest((passive.magnitude[row],)))
            _draw_band(both, passive, row, factor, PASSIVE, "passive")
            _draw_band(both, active, row, factor, ACTIVE, "active")
            label(both, shorten_name(passive.names[row]), unit)
            factor, unit = engineering(active.units[row], largest((active.magnitude[row],)))
            _draw_band(alone, active, row, factor, ACTIVE, "active")
            label(alone, shorten_name(active.names[row]), unit)
        _add_legend(grid[0, 0], loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        grid[0, 1].set_title("active, enlarged")
        for axes in grid[-1]:
            axes.set_xlabel("time (s)")
        for axes in grid.flat:
            shade(axes, shaded)
        figure.suptitle(title)

    draw(path, 12.0, 1.2 + 2.5 * count, paint)


def draw_spectra(
    path: Path,
    frequency: Array,
    passive: Array,
    active: Array,
    names: Sequence[str],
    unit: str,
    *,
    title: str = "",
) -> None:
    """Densities (signals, frequencies) in unit^2/Hz; below them the RMS of all that lies under a frequency.

    Densities are averaged over hundredths of a decade.  The axes end ``DECADES`` below the largest: what is lower is
    rounding.
    """
    if passive.shape != (len(names), len(frequency)) or active.shape != passive.shape:
        raise ValueError(
            f"expected densities of shape {(len(names), len(frequency))}, got {passive.shape}, {active.shape}"
        )

    def paint(figure: Figure) -> None:
        grid = figure.subplots(2, len(names), sharex=True, sharey="row", squeeze=False)
        sums = [cumulative_rms(frequency, psd) for psd in (passive, active)]
        factor, scaled = engineering(unit, largest(sums))
        top = largest((passive[:, 1:], active[:, 1:])) or 1.0
        shown = np.maximum(passive, active).max(axis=0) > top * 10.0**-DECADES
        last = frequency[shown][-1] if shown.any() else frequency[-1]
        for column, name in enumerate(names):
            density, below = grid[:, column]
            for psd, rms, colour, case in zip(
                (passive, active), sums, (PASSIVE, ACTIVE), ("passive", "active"), strict=True
            ):
                middle, mean = log_bands(frequency, psd[column])
                density.loglog(middle, _hide_zeros(mean), color=colour, label=case, lw=1.2)
                below.loglog(frequency[1:], _hide_zeros(rms[column, 1:]) * factor, color=colour, label=case)
            density.set_title(shorten_name(name))
            below.set_xlabel("frequency (Hz)")
        grid[0, 0].set_xlim(frequency[1], last)
        grid[0, 0].set_ylim(top * 10.0**-DECADES, top * 10.0)
        label(grid[0, 0], "PSD", f"{pretty(unit)}$^2$/Hz")
        label(grid[1, 0], "RMS below frequency", scaled)
        _add_legend(grid[0, 0])
        figure.suptitle(title)

    draw(path, 2.0 + 4.0 * len(names), 8.5, paint)


def draw_image_point(path: Path, passive: Scatter, active: Scatter, *, title: str = "") -> None:
    """Image points about their mean with their convex hulls; on the right the active ones enlarged."""

    def paint(figure: Figure) -> None:
        both, alone = figure.subplots(1, 2)
        factor, unit = engineering(passive.unit, max(passive.radius_max, active.radius_max))
        _draw_cloud(both, passive, factor, PASSIVE, "passive")
        _draw_cloud(both, active, factor, ACTIVE, "active")
        both.set_title("passive and active")
        own, own_unit = engineering(active.unit, active.radius_max)
        _draw_cloud(alone, active, own, ACTIVE, "active")
        alone.set_title("active, enlarged")
        for axes, text in ((both, unit), (alone, own_unit)):
            axes.set_aspect("equal", adjustable="datalim")
            axes.set_xlabel(f"x ({text})")
            axes.set_ylabel(f"y ({text})")
        for axes in (both, alone):
            _add_legend(axes, loc="upper center", bbox_to_anchor=(0.5, -0.12), ncols=1)
        figure.suptitle(title)

    draw(path, 12.0, 7.2, paint)


@dataclass(frozen=True, eq=False)
class Panel:
    """One panel of a stack of histories: signals of one unit, shown in ``unit``.

    ``target`` (signals, bins) is drawn dashed on the signals; ``logarithmic`` shows magnitudes.
    """

    title: str
    envelope: Envelope
    unit: str
    target: Array | None = None
    logarithmic: bool = False
    legend: tuple[str, ...] = ()


def draw_histories(
    path: Path,
    panels: Sequence[Panel],
    *,
    title: str = "",
    mark_s: float | None = None,
    shaded: Sequence[tuple[float, float]] = (),
) -> None:
    """Panels above one another on one time axis; ``mark_s`` draws a line at an instant (end of a profile).

    ``shaded``: when a fault acts [s].
    """

    def paint(figure: Figure) -> None:
        grid = figure.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, panel in zip(grid, panels, strict=True):
            _draw_panel(axes, panel)
            shade(axes, shaded)
            if mark_s is not None:
                axes.axvline(mark_s, color=REFERENCE, lw=1.0, ls=":")
        grid[-1].set_xlabel("time (s)")
        figure.suptitle(title)

    draw(path, 11.0, 1.0 + 2.6 * len(panels), paint)


def draw_slew(
    path: Path,
    orientation: Envelope,
    target: Array,
    error: Envelope,
    bus: Envelope,
    fine: Envelope,
    *,
    title: str = "",
    profile_end_s: float | None = None,
    shaded: Sequence[tuple[float, float]] = (),
) -> None:
    """A slew: orientation and target [rad], error [rad], reaction of the bus [rad], fine displacement [m].

    ``target`` has the shape of the orientation's ``low``: (3, bins).  ``profile_end_s`` marks the end of the
    commanded motion.
    """
    angles = ("roll", "pitch", "yaw")
    panels = (
        Panel("orientation", orientation, "deg", target=target, legend=angles),
        Panel("error magnitude", error, "deg", logarithmic=True, legend=angles),
        Panel("bus rotation", bus, "rad", legend=tuple("xyz")),
        Panel("fine displacement", fine, "m", legend=("leg 1", "leg 2", "leg 3")),
    )
    draw_histories(path, panels, title=title, mark_s=profile_end_s, shaded=shaded)


def draw_table(path: Path, header: Sequence[str], rows: Sequence[Sequence[str]], *, title: str = "") -> None:
    """A table as a picture: ``rows`` of text under a ``header``; the first column is left-aligned."""
    if any(len(row) != len(header) for row in rows):
        raise ValueError(f"every row must have the {len(header)} entries of the header")
    texts = [header, *rows]
    widths = [2 + max(len(line[column]) for line in texts) for column in range(len(header))]

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        axes.axis("off")
        axes.set_xlim(0.0, sum(widths))
        axes.set_ylim(len(texts), 0.0)
        for place, line in enumerate(texts):
            edge = 0.0
            for column, (text, width) in enumerate(zip(line, widths, strict=True)):
                left = column == 0
                axes.text(
                    edge + (0.5 if left else width - 0.5),
                    place + 0.5,
                    text,
                    ha="left" if left else "right",
                    va="center",
                    weight="bold" if place == 0 else "normal",
                )
                edge += width
        for height, thickness in ((0.0, 1.5), (1.0, 1.0), (float(len(texts)), 1.5)):
            axes.axhline(height, color="black", lw=thickness, clip_on=False)
        figure.suptitle(title)

    draw(path, 0.6 + 0.115 * sum(widths), 0.6 + 0.36 * len(texts), paint)


def shorten_name(name: str) -> str:
    """A column's name without its component, in words: ``plant.payload_rotation.x`` is payload rotation x."""
    return name.split(".", 1)[-1].replace("_", " ").replace(".", " ")


def _draw_band(axes: Axes, envelope: Envelope, row: int, factor: float, colour: str, text: str) -> None:
    low, high = envelope.low[row] * factor, envelope.high[row] * factor
    # The edge keeps a band visible where it is thinner than a pixel.
    axes.fill_between(envelope.time, low, high, color=colour, lw=0.8, label=text)


def _draw_cloud(axes: Axes, scatter: Scatter, factor: float, colour: str, text: str) -> None:
    points = (scatter.points - scatter.centre) * factor
    hull = (scatter.hull - scatter.centre) * factor
    unit = engineering(scatter.unit, scatter.radius_rms)
    axes.plot(*points.T, ".", color=colour, ms=2.5, alpha=0.5, mew=0.0)
    axes.plot(
        *np.concatenate((hull, hull[:1])).T,
        color=colour,
        label=f"{text}: RMS radius {scatter.radius_rms * unit[0]:.3g} {unit[1]}",
    )


def _draw_panel(axes: Axes, panel: Panel) -> None:
    envelope = panel.envelope
    if panel.unit == "deg":
        factor, unit = np.degrees(1.0), "deg"
    else:
        factor, unit = engineering(panel.unit, largest((envelope.magnitude,)))
    legend = panel.legend or tuple(shorten_name(name) for name in envelope.names)
    for row, text in enumerate(legend):
        colour = AXES[row % len(AXES)]
        if panel.logarithmic:
            magnitude = _hide_zeros(envelope.magnitude[row]) * factor
            axes.semilogy(envelope.time, magnitude, color=colour, label=text)
            continue
        # One line where the signal is smooth, a light band between its extremes where it is not.
        low, high = envelope.low[row] * factor, envelope.high[row] * factor
        axes.fill_between(envelope.time, low, high, color=colour, alpha=0.3, lw=0.0)
        axes.plot(envelope.time, low, color=colour, label=text)
        axes.plot(envelope.time, high, color=colour)
        if panel.target is not None:
            axes.plot(envelope.time, panel.target[row] * factor, color="black", lw=1.2, ls=(0, (4, 4)))
    if panel.target is not None:
        axes.plot([], [], color="black", lw=1.2, ls=(0, (1.5, 1.5)), label="target")
    label(axes, panel.title, unit)
    _add_legend(axes, loc="center left", bbox_to_anchor=(1.0, 0.5))


def _hide_zeros(values: Array) -> Array:
    """Zero has no place on a logarithmic axis: a gap instead."""
    return np.where(values > 0.0, values, np.nan)


def _add_legend(axes: Axes, **places: object) -> None:
    handles = axes.legend(**places)
    for handle in handles.legend_handles:
        if handle is not None and hasattr(handle, "set_linewidth"):
            handle.set_linewidth(3.0)
