"""The figures of a budget: bars by source and band, and cumulative RMS with the modes that matter."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...results.style import ACTIVE, PASSIVE, REFERENCE, draw
from .results import Entry

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito, and grey for what is small.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442")
OTHERS = "#999999"
CASE_COLOURS = {"passive": PASSIVE, "active": ACTIVE}
LINES = ("-", "--", ":", "-.")  # by system
LEAST_MODE = 0.03  # share of a mode that is marked


def draw_bands(path: Path, entries: Sequence[Entry]) -> None:
    """A panel for each system and case: shares of the variance in bands, stacked by source."""

    def paint(figure: Figure) -> None:
        systems = _list_systems(entries)
        panels = figure.subplots(len(systems), 2, squeeze=False)
        named = _choose_channels(entries)
        for entry in entries:
            column = 0 if entry.case == "passive" else 1
            _stack(panels[systems.index(entry.model.name), column], entry, named)
        for axes in panels[:, 0]:
            axes.set_ylabel("share of the variance (%)")
        for axes in panels[-1]:
            axes.set_xlabel("frequency band (Hz)")
        found: dict[str, Artist] = {}
        for axes in panels.flat:
            bars, labels = axes.get_legend_handles_labels()
            found |= dict(zip(labels, bars, strict=True))
        order = [name for name in (*named, "others") if name in found]
        figure.legend([found[name] for name in order], order, loc="outside lower center", ncols=4, fontsize=11)
        figure.suptitle(entries[0].wanted.title)

    draw(path, 13.0, 3.9 * len(_list_systems(entries)) + 1.6, paint)


def draw_cumulative(path: Path, entries: Sequence[Entry]) -> None:
    """RMS of all below a frequency, passive and active, of each system; the modes that matter when active."""

    def paint(figure: Figure) -> None:
        axes = figure.subplots()
        systems = _list_systems(entries)
        largest = 0.0
        for entry in entries:
            frequency, rms = entry.cumulative
            style = LINES[systems.index(entry.model.name) % len(LINES)]
            label = f"{entry.model.name}, {entry.case}: {entry.rms:.3g}"
            axes.loglog(frequency, np.where(rms > 0.0, rms, np.nan), style, color=CASE_COLOURS[entry.case], label=label)
            largest = max(largest, entry.rms)
        smallest = min((entry.rms for entry in entries if entry.rms), default=1.0)
        unit = entries[0].wanted.requirement.limit.unit.replace("u", "\N{MICRO SIGN}", 1)
        limit = entries[0].wanted.requirement.limit.value
        if limit < 10.0 * largest:
            axes.axhline(limit, color=REFERENCE, ls=":", lw=1.3, label=f"limit: {limit:g}")
        axes.set(
            xlabel="frequency (Hz)", ylabel=f"RMS of all below ({unit})", xlim=(1e-2, frequency[-1]),
            ylim=(1e-3 * smallest, 3.0 * max(largest, limit if limit < 10.0 * largest else 0.0)),
        )  # fmt: skip
        _mark_modes(axes, entries)
        figure.legend(loc="outside lower center", ncols=2, fontsize=11)
        figure.suptitle(entries[0].wanted.title)

    draw(path, 11.5, 7.0, paint)


def _list_systems(entries: Sequence[Entry]) -> list[str]:
    return list(dict.fromkeys(entry.model.name for entry in entries))


def _choose_channels(entries: Sequence[Entry]) -> list[str]:
    """The channels with a colour of their own: those with the largest share in any of the budgets."""
    share: dict[str, float] = {}
    for entry in entries:
        for channel, part in zip(entry.budget.channels, entry.budget.by_channel, strict=True):
            share[channel] = max(share.get(channel, 0.0), abs(entry.budget.share(part)))
    return sorted(share, key=lambda channel: -share[channel])[: len(COLOURS)]


def _stack(axes: Axes, entry: Entry, named: Sequence[str]) -> None:
    budget = entry.budget
    shares = 100.0 * np.array([[budget.share(part) for part in row] for row in budget.contribution.sum(axis=2)])
    places = np.arange(shares.shape[1] if shares.size else 0)
    rows = [(name, colour, [name]) for name, colour in zip(named, COLOURS, strict=False)]
    rows.append(("others", OTHERS, [name for name in budget.channels if name not in named]))
    above, below = np.zeros(len(places)), np.zeros(len(places))
    for name, colour, members in rows:
        chosen = [k for k, channel in enumerate(budget.channels) if channel in members]
        if not chosen:
            continue
        height = shares[chosen].sum(axis=0)
        axes.bar(places, height, bottom=np.where(height < 0.0, below, above), color=colour, label=name, width=0.8)
        above, below = above + np.maximum(height, 0.0), below + np.minimum(height, 0.0)
    labels = [f"<{high:g}" if low == 0.0 else f"{low:g}-{high:g}" for low, high in pairwise(budget.edges)]
    axes.set_xticks(places, labels, rotation=60, ha="right", fontsize=10)
    axes.axhline(0.0, color="black", lw=0.8)
    unit = entry.wanted.requirement.limit.unit.replace("u", "\N{MICRO SIGN}", 1)
    axes.set_title(f"{entry.model.name}, {entry.case}: RMS {entry.rms:.3g} {unit}")


def _mark_modes(axes: Axes, entries: Sequence[Entry]) -> None:
    """Modes with a share in one of the active budgets; those with nearly the same frequency once."""
    marked: list[float] = []
    for entry in entries:
        if entry.case == "active":
            for name, part in zip(entry.budget.modes, entry.budget.by_mode, strict=True):
                if name.endswith("Hz") and abs(entry.budget.share(part)) > LEAST_MODE:
                    marked.append(float(name.removesuffix(" Hz")))
    shown: list[float] = []
    for frequency in sorted(marked):
        axes.axvline(frequency, color=REFERENCE, lw=0.8, ls=":")
        if not shown or frequency > 1.1 * shown[-1]:
            shown.append(frequency)
            axes.annotate(
                f" {frequency:.3g} Hz", (frequency, 0.01), xycoords=("data", "axes fraction"), rotation=90, fontsize=10,
                ha="right", va="bottom", color=REFERENCE,
            )  # fmt: skip
