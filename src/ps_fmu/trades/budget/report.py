"""``ps-fmu analyse budget``: the budgets of the requirements, as sentences, tables, figures and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from ...analyses.result import AnalysisResult, paint_pictures
from ...analyses.system import load_built_system
from ...analyses.table import SYSTEM, AnalysisOptions
from ...cosim import System, read_system
from ...interface.linear_system import STEP
from ...pointing.budget import UncertaintyFactors
from ...product.files import find_product
from ...results.report import Picture
from ...results.style import ACTIVE, PASSIVE, REFERENCE
from ...results.tables import Table
from ...runs.built_fmus import provide_fmus
from .results import (
    CASES,
    POINTS,
    SignalBudget,
    compute_budgets,
    describe_band,
    list_wanted,
    read_factors,
    read_with_parameters,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSTRUMENT = "Instrument.ssd"
REQUIREMENTS = "requirements.toml"
_LARGEST = 4  # channels of a budget in the table
# Okabe and Ito, and grey for what is small.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442")
OTHERS = "#999999"
CASE_COLOURS = {"passive": PASSIVE, "active": ACTIVE}
LINES = ("-", "--", ":", "-.")  # by system
LEAST_MODE = 0.03  # share of a mode that is marked



def analyse(options: AnalysisOptions, points: int = POINTS) -> AnalysisResult:
    """Compute the budgets of the requirements and draw them.

    Of the system of the options; with the product's default system also of its instrument with sensors and coils.
    ``points``: frequencies of a density besides those around the poles.
    """
    factors = read_factors(options.uncertainty)
    systems = read_with_parameters(_read_systems(options), options.parameters)
    path = options.requirements or find_product().system / REQUIREMENTS
    entries: list[SignalBudget] = []
    with tqdm(total=len(systems), unit="system", desc="budget", disable=not options.progress) as bar:
        for system in systems:
            wanted = list_wanted(path, system, system.experiment.step or STEP)
            entries += compute_budgets(system, wanted, factors, points)
            bar.update()
    return AnalysisResult(
        name="budget",
        title="Who eats the pointing error?",
        text=[*_explain(factors), *(f"{name}: {text}" for name, text in _list_sentences(entries))],
        tables=list(_tabulate(entries)),
        pictures=_draw(options, entries),
        data={"budgets": [_describe(entry) for entry in entries]},
    )


def _read_systems(options: AnalysisOptions) -> list[System]:
    systems = [load_built_system(options)]
    instrument = find_product().system / INSTRUMENT
    if options.system.resolve() == (find_product().system / SYSTEM).resolve():
        provide_fmus(options.fmus, instrument)
        systems.append(read_system(instrument, options.fmus))
    return systems


def _explain(factors: UncertaintyFactors) -> Iterator[str]:
    yield (
        "Closed form of what the FMUs step: the share of each source, frequency band and mode in the variance of each "
        "index. Passive: isolator and line-of-sight loop off; active: both on, where the system has them. Cross terms "
        "of correlated sources and of modes are shared half and half, so that contributions add up; one may be "
        "negative, and then another is above 100 %. Lines of wheels are averaged over their phases. The rest, among "
        "the modes, is rigid motion, filters and delays."
    )
    if factors.limits or factors.factors != (1.0,):
        edges = [0.0, *factors.limits, np.inf]
        parts = [
            f"{factor:g} {f'above {low:g} Hz' if high == np.inf else describe_band(low, high)}"
            for factor, low, high in zip(factors.factors, edges[:-1], edges[1:], strict=True)
        ]
        yield f"All numbers have uncertainty factors on the amplitude: {', '.join(parts)}."


def _list_sentences(entries: Sequence[SignalBudget]) -> Iterator[tuple[str, str]]:
    """Of each system and requirement the active target that takes most of its limit."""
    for group in _group(entries):
        worst = max((e for e in group if e.case == "active"), key=_rank)
        yield worst.model.name, f"{worst.sentence}."


def _rank(entry: SignalBudget) -> float:
    return entry.rms / entry.wanted.requirement.limit.value


def _group(entries: Sequence[SignalBudget]) -> list[list[SignalBudget]]:
    """Entries of the same system and requirement."""
    found: dict[tuple[int, str], list[SignalBudget]] = {}
    for entry in entries:
        found.setdefault((id(entry.model), entry.wanted.requirement.name), []).append(entry)
    return list(found.values())


def _tabulate(entries: Sequence[SignalBudget]) -> Iterator[Table]:
    """Of each system: totals, and of the signals that take most of their limits the largest sources and modes."""
    for system in dict.fromkeys(entry.model.name for entry in entries):
        own = [entry for entry in entries if entry.model.name == system]
        worst = [max((e for e in group if e.case == "active"), key=_rank) for group in _group(own)]
        yield _tabulate_totals(system, own)
        yield _tabulate_channels(system, worst)
        yield _tabulate_modes(system, worst)


def _tabulate_totals(system: str, entries: Sequence[SignalBudget]) -> Table:
    rows = []
    for entry in entries:
        limit, expected = entry.wanted.requirement.limit, entry.expected
        largest = "-"
        if entry.budget.variance:
            channel, low, high, part = entry.budget.dominant()
            largest = f"{100.0 * part:.0f} % {channel}, {low:g}-{high:g} Hz"
        rows.append(
            (
                entry.case, entry.wanted.requirement.name, entry.wanted.short, f"{entry.rms:.3g} {limit.unit}",
                "-" if expected is None else _percent(expected / limit.value), largest,
            )
        )  # fmt: skip
    header = ("case", "requirement", "signal", "RMS", "of limit (%)", "most by")
    caption = (
        f"{system}: RMS, what a Gaussian error takes of the limit (no confidence in it), and the largest contribution "
        "of a source in a band"
    )
    return Table(caption, header, rows)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f}" if share >= 1.0 else f"{100.0 * share:.3g}"


def _tabulate_channels(system: str, entries: Sequence[SignalBudget]) -> Table:
    rows = []
    for entry in entries:
        budget = entry.budget
        for k in np.argsort(-np.abs(budget.by_channel))[:_LARGEST]:
            bands = budget.contribution[k].sum(axis=1)
            band = int(np.abs(bands).argmax())
            low, high = budget.edges[band : band + 2]
            rows.append(
                (
                    entry.wanted.requirement.name, entry.wanted.short, budget.channels[k],
                    f"{100.0 * budget.share(budget.by_channel[k]):.1f}", f"{low:g}-{high:g}",
                    f"{100.0 * budget.share(bands[band]):.1f}",
                )
            )  # fmt: skip
    header = ("requirement", "signal", "source", "share (%)", "largest band (Hz)", "share there (%)")
    return Table(f"{system}: the largest sources, active, where most of a limit is taken", header, rows)


def _tabulate_modes(system: str, entries: Sequence[SignalBudget]) -> Table:
    rows = []
    for entry in entries:
        shares = [entry.budget.share(part) for part in entry.budget.by_mode]
        order = np.argsort(-np.abs(shares))[:_LARGEST]
        text = ", ".join(f"{entry.budget.modes[k]}: {100.0 * shares[k]:.1f} %" for k in order)
        rows.append((entry.wanted.requirement.name, entry.wanted.short, text))
    header = ("requirement", "signal", "modes and their shares")
    return Table(f"{system}: the largest modes of the same budgets", header, rows)


def _draw(options: AnalysisOptions, entries: Sequence[SignalBudget]) -> list[Picture]:
    """Two pictures for each requirement, of the signal that takes most of its limit in the last system, active."""
    figures = []
    for number, group in enumerate(_group([e for e in entries if e.model is entries[-1].model]), 1):
        worst = max((e for e in group if e.case == "active"), key=_rank).wanted
        shown = [
            e
            for e in entries
            if e.wanted.requirement.name == worst.requirement.name and e.wanted.target.label == worst.target.label
        ]
        figures += [
            (
                f"bands_{number}", f"{worst.title}: variance by source and band.",
                (13.0, 3.9 * len(_list_systems(shown)) + 1.6), paint_bands, shown,
            ),
            (
                f"cumulative_{number}", f"{worst.title}: RMS of all below a frequency, and the modes that matter.",
                (11.5, 7.0), paint_cumulative, shown,
            ),
        ]  # fmt: skip
    return paint_pictures(options.output, "budget", *figures)


def _describe(entry: SignalBudget) -> dict[str, object]:
    """All numbers of a budget, in the SI unit of the signal."""
    budget, requirement = entry.budget, entry.wanted.requirement
    return {
        "system": entry.model.name,
        "case": entry.case,
        "isolated": CASES[entry.case],
        "requirement": requirement.name,
        "index": requirement.about,
        "signal": entry.wanted.target.label,
        "limit": entry.wanted.target.limit,
        "rms": budget.rms,
        "variance": budget.variance,
        "sources": list(budget.channels),
        "edges_Hz": budget.edges,
        "modes": list(budget.modes),
        "by_source": budget.by_channel,
        "by_band": budget.by_band,
        "by_mode": budget.by_mode,
        "by_source_and_band": budget.contribution.sum(axis=2),
        "sentence": entry.sentence,
    }


def paint_bands(figure: Figure, entries: Sequence[SignalBudget]) -> None:
    """A panel for each system and case: shares of the variance in bands, stacked by source."""
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


def paint_cumulative(figure: Figure, entries: Sequence[SignalBudget]) -> None:
    """RMS of all below a frequency, passive and active, of each system; the modes that matter when active."""
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


def _list_systems(entries: Sequence[SignalBudget]) -> list[str]:
    return list(dict.fromkeys(entry.model.name for entry in entries))


def _choose_channels(entries: Sequence[SignalBudget]) -> list[str]:
    """The channels with a colour of their own: those with the largest share in any of the budgets."""
    share: dict[str, float] = {}
    for entry in entries:
        for channel, part in zip(entry.budget.channels, entry.budget.by_channel, strict=True):
            share[channel] = max(share.get(channel, 0.0), abs(entry.budget.share(part)))
    return sorted(share, key=lambda channel: -share[channel])[: len(COLOURS)]


def _stack(axes: Axes, entry: SignalBudget, named: Sequence[str]) -> None:
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


def _mark_modes(axes: Axes, entries: Sequence[SignalBudget]) -> None:
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
