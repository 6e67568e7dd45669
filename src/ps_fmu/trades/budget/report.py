"""``ps-fmu analyse budget``: the budgets of the requirements, as sentences, tables, figures and numbers."""

from __future__ import annotations

from collections.abc import Container, Iterator, Mapping, Sequence
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from tqdm import tqdm

from ...analyses.result import AnalysisResult, paint_pictures
from ...analyses.system import load_own_systems
from ...analyses.table import SYSTEM, AnalysisOptions
from ...interface.linear_system import Circuit
from ...interface.system_model import STEP
from ...mechanism.quantities import Array
from ...pointing.budget import UncertaintyFactors, drop_source
from ...product.files import find_product
from ...results.report import Picture
from ...results.style import ACTIVE, PASSIVE, REFERENCE
from ...results.tables import Table
from .results import (
    CASES,
    POINTS,
    SignalBudget,
    compute_budgets,
    describe_band,
    list_wanted,
    read_factors,
)

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

INSTRUMENT = "Instrument.ssd"
REQUIREMENTS = "requirements.toml"
_LARGEST = 4  # lines of a budget in the tables
# Okabe and Ito, and grey for what is small.
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#56B4E9", "#F0E442")
OTHERS = "#999999"
CASE_COLOURS = {"passive": PASSIVE, "active": ACTIVE}
DASHES = ("-", "--", ":", "-.")  # by system
LEAST_SHARE = 0.03  # of a resonance that is marked
LEAST_STACK = 0.5  # %: what is smaller has no colour of its own
LEAST_CORRELATION = 0.1  # in the table



def analyse(options: AnalysisOptions, points: int = POINTS) -> AnalysisResult:
    """Compute the budgets of the requirements and draw them.

    Of the system of the options; with the product's default system also of its instrument with sensors and coils.
    ``points``: frequencies of a density besides those around the poles.
    """
    factors = read_factors(options.uncertainty)
    folder = find_product().system
    others = [folder / INSTRUMENT] if options.system.resolve() == (folder / SYSTEM).resolve() else []
    systems = load_own_systems(options, *others)
    path = options.requirements or folder / REQUIREMENTS
    entries: list[SignalBudget] = []
    with tqdm(total=len(systems), unit="system", desc="budget", disable=not options.progress) as bar:
        for system in systems:
            wanted = list_wanted(path, system, system.experiment.step or STEP)
            entries += compute_budgets(system, wanted, factors, points)
            bar.update()
    return AnalysisResult(
        name="budget",
        title="Where does the pointing error come from?",
        text=[
            *_explain(factors, entries),
            *(f"{name}: {text}" for name, text in (*_list_sentences(entries), *_list_reserves(entries))),
        ],
        tables=list(_tabulate(entries)),
        pictures=_draw(options, entries),
        data={"budgets": [_describe(entry) for entry in entries]},
    )


def _explain(factors: UncertaintyFactors, entries: Sequence[SignalBudget]) -> Iterator[str]:
    yield (
        "Closed form of the linear model that the FMUs step, in the steady state: the share of each source, frequency "
        "band and resonance in the variance of each index. Passive: isolator and line-of-sight loop off; active: both "
        "on, where the system has them. Of correlated sources each has half of their cross terms; those that cancel "
        "each other are one line, with what each would make alone below. A resonance is what lies within ten "
        "half-power half-widths of lightly damped modes."
    )
    if any(has_unknown_phases(entry) for entry in entries):
        yield (
            "Lines of wheels: the RMS is the mean over their initial phases, which a run draws by its seed; the worst "
            "phases are those at which harmonics of one frequency, such as force and torque of a wheel, add up most."
        )
    if factors.limits or factors.factors != (1.0,):
        edges = [0.0, *factors.limits, np.inf]
        parts = [
            f"{factor:g} {f'above {low:g} Hz' if high == np.inf else describe_band(low, high)}"
            for factor, low, high in zip(factors.factors, edges[:-1], edges[1:], strict=True)
        ]
        yield f"All numbers have uncertainty factors on the amplitude: {', '.join(parts)}."


def _list_reserves(entries: Sequence[SignalBudget]) -> Iterator[tuple[str, str]]:
    """How far each system, active, is from instability; an unstable one has no budget."""
    for model in {entry.model.name: entry.model for entry in entries}.values():
        reserve = Circuit(model, active=True).reserve
        yield model.name, f"active, the linear model is stable{'' if reserve is None else f': {reserve}'}."


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
    """Of each system: totals, and of the signals that take most of their limits the largest lines and resonances."""
    for system in _list_systems(entries):
        own = [entry for entry in entries if entry.model.name == system]
        worst = [max((e for e in group if e.case == "active"), key=_rank) for group in _group(own)]
        yield _tabulate_totals(system, own)
        yield _tabulate_lines(system, worst)
        if any(len(line.channels) > 1 for entry in worst for line in entry.budget.lines[:_LARGEST]):
            yield _tabulate_channels(system, worst)
        yield _tabulate_resonances(system, worst)


def has_unknown_phases(entry: SignalBudget) -> bool:
    """Whether unknown phases of lines matter for the RMS: by a thousandth, or more."""
    return entry.budget.worst_rms > 1.001 * entry.budget.rms


def _tabulate_totals(system: str, entries: Sequence[SignalBudget]) -> Table:
    rows, phased = [], any(has_unknown_phases(entry) for entry in entries)
    for entry in entries:
        limit, expected = entry.wanted.requirement.limit, entry.expected
        largest = "-"
        if entry.budget.variance:
            line, low, high, part = entry.budget.dominant()
            largest = f"{100.0 * part:.0f} % {line}, {low:g}-{high:g} Hz"
        worst = f" ({entry.worst_rms:.3g})" if phased else ""
        rows.append(
            (
                entry.case, entry.wanted.requirement.name, entry.wanted.short, f"{entry.rms:.3g}{worst} {limit.unit}",
                "-" if expected is None else _percent(expected / limit.value), largest,
            )
        )  # fmt: skip
    header = ("case", "requirement", "signal", f"RMS{' (worst phases)' if phased else ''}", "of limit (%)", "most by")
    caption = (
        f"{system}: totals; RMS, what a Gaussian error of it takes of the limit (no confidence in it), and the largest "
        "contribution of a source in a band"
    )
    return Table(caption, header, rows)


def _percent(share: float) -> str:
    return f"{100.0 * share:.0f}" if share >= 1.0 else f"{100.0 * share:.3g}"


def _tabulate_lines(system: str, entries: Sequence[SignalBudget]) -> Table:
    rows = []
    for entry in entries:
        budget = entry.budget
        for line in budget.lines[:_LARGEST]:
            bands = budget.contribution(line)
            band = int(bands.argmax())
            low, high = budget.edges[band : band + 2]
            rows.append(
                (
                    entry.wanted.requirement.name, entry.wanted.short, line.name,
                    f"{100.0 * budget.share(float(bands.sum())):.1f}", f"{low:g}-{high:g}",
                    f"{100.0 * budget.share(float(bands[band])):.1f}",
                )
            )  # fmt: skip
    header = ("requirement", "signal", "source", "share (%)", "largest band (Hz)", "share there (%)")
    return Table(f"{system}: the largest sources; active, of the signals that take most of a limit", header, rows)


def _tabulate_channels(system: str, entries: Sequence[SignalBudget]) -> Table:
    """What is joined in the largest lines: the RMS of each channel alone, and its correlations."""
    rows = []
    for entry in entries:
        budget, unit = entry.budget, entry.wanted.requirement.limit.unit
        for line in (line for line in budget.lines[:_LARGEST] if len(line.channels) > 1):
            for k in line.channels:
                others = sorted((m for m in line.channels if m != k), key=lambda m: budget.correlation[k, m])
                text = ", ".join(
                    f"{budget.correlation[k, m]:+.2f} {drop_source(budget.channels[m], budget.channels[k])}"
                    for m in others
                    if abs(budget.correlation[k, m]) >= LEAST_CORRELATION
                )
                alone = f"{budget.alone[k] * entry.wanted.scale:.3g} {unit}"
                rows.append(
                    (entry.wanted.requirement.name, entry.wanted.short, budget.channels[k], alone, text)
                )  # fmt: skip
    header = ("requirement", "signal", "source", "RMS alone", "correlation with")
    caption = (
        f"{system}: sources that cancel each other; what each makes alone, and the correlation of what two make (-1: "
        "they cancel, +1: they add up)"
    )
    return Table(caption, header, rows)


def _tabulate_resonances(system: str, entries: Sequence[SignalBudget]) -> Table:
    rows = []
    for entry in entries:
        shares = [entry.budget.share(float(part)) for part in entry.budget.by_resonance]
        order = np.argsort(shares)[::-1][:_LARGEST]
        text = ", ".join(f"{entry.budget.resonance_names[k]}: {100.0 * shares[k]:.1f} %" for k in order)
        rows.append((entry.wanted.requirement.name, entry.wanted.short, text))
    header = ("requirement", "signal", "resonances and their shares")
    return Table(f"{system}: the largest resonances of the same budgets", header, rows)


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
                f"cumulative_{number}", f"{worst.title}: RMS of all below a frequency, and the resonances that matter.",
                (11.5, 7.0), paint_cumulative, shown,
            ),
        ]  # fmt: skip
    return paint_pictures(options.output, "budget", *figures)


def _describe(entry: SignalBudget) -> dict[str, object]:
    """All numbers of a budget, in the SI unit of the signal."""
    budget, requirement = entry.budget, entry.wanted.requirement
    parts = [budget.contribution(line) for line in budget.lines]
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
        "worst_phase_rms": budget.worst_rms,
        "sources": [line.name for line in budget.lines],
        "edges_Hz": budget.edges,
        "resonances": list(budget.resonance_names),
        "by_source": [float(part.sum()) for part in parts],
        "by_band": budget.by_band,
        "by_resonance": budget.by_resonance,
        "by_source_and_band": parts,
        "channels": list(budget.channels),
        "rms_alone": budget.alone,
        "correlation": budget.correlation,
        "sentence": entry.sentence,
    }


def paint_bands(figure: Figure, entries: Sequence[SignalBudget]) -> None:
    """A panel for each system and case: shares of the variance in bands, stacked by source."""
    systems = _list_systems(entries)
    panels = figure.subplots(len(systems), 2, squeeze=False, sharex=True, sharey=True)
    stacks = _choose_stacks(entries)
    for entry in entries:
        column = 0 if entry.case == "passive" else 1
        _stack(panels[systems.index(entry.model.name), column], entry, stacks)
    for axes in panels[:, 0]:
        axes.set_ylabel("frequency band (Hz)")
    for axes in panels[-1]:
        axes.set_xlabel("share of the variance (%)")
    found: dict[str, Artist] = {}
    for axes in panels.flat:
        bars, labels = axes.get_legend_handles_labels()
        found |= dict(zip(labels, bars, strict=True))
    order = [name for name in (*stacks, "others") if name in found]
    figure.legend([found[name] for name in order], order, loc="outside lower center", ncols=3)
    figure.suptitle(entries[0].wanted.title)


def paint_cumulative(figure: Figure, entries: Sequence[SignalBudget]) -> None:
    """RMS of all below a frequency, passive and active, of each system; the resonances that matter when active."""
    axes = figure.subplots()
    systems = _list_systems(entries)
    largest = 0.0
    for entry in entries:
        frequency, rms = entry.cumulative
        style = DASHES[systems.index(entry.model.name) % len(DASHES)]
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
    _mark_resonances(axes, entries)
    figure.legend(loc="outside lower center", ncols=2, fontsize=11)
    figure.suptitle(entries[0].wanted.title)


def _list_systems(entries: Sequence[SignalBudget]) -> list[str]:
    return list(dict.fromkeys(entry.model.name for entry in entries))


def _choose_stacks(entries: Sequence[SignalBudget]) -> dict[str, tuple[str, ...]]:
    """The sources with a colour of their own, and their channels: the largest in any of the budgets.

    Channels that one of the budgets joins are together in all.
    """
    groups: list[set[str]] = []
    for entry in entries:
        for line in entry.budget.lines:
            own = {entry.budget.channels[k] for k in line.channels}
            own = own.union(*(group for group in groups if group & own))
            groups = [*(group for group in groups if not group & own), own]
    share = {
        tuple(sorted(group)): max(float(_stack_bands(entry, group).sum()) for entry in entries) for group in groups
    }
    largest = sorted(share, key=lambda members: -share[members])[: len(COLOURS)]
    return {_name_stack(members): members for members in largest if share[members] >= LEAST_STACK}


def _name_stack(members: Sequence[str]) -> str:
    first, *others = members
    return ", ".join([first, *(drop_source(name, first) for name in others)])


def _stack_bands(entry: SignalBudget, members: Container[str]) -> Array:
    """Shares of some channels in the bands, %."""
    budget = entry.budget
    chosen = [k for k, channel in enumerate(budget.channels) if channel in members]
    return np.array([100.0 * budget.share(float(part)) for part in budget.pairs[:, chosen].sum(axis=(1, 2))])


def _stack(axes: Axes, entry: SignalBudget, stacks: Mapping[str, tuple[str, ...]]) -> None:
    budget = entry.budget
    seen = {name for members in stacks.values() for name in members}
    others = {"others": tuple(name for name in budget.channels if name not in seen)}
    places, beside = np.arange(len(budget.edges) - 1), np.zeros(len(budget.edges) - 1)
    for (name, members), colour in zip({**stacks, **others}.items(), [*COLOURS[: len(stacks)], OTHERS], strict=True):
        if any(channel in members for channel in budget.channels):
            width = _stack_bands(entry, members)
            axes.barh(places, width, left=beside, color=colour, label=name, height=0.8)
            beside = beside + width
    labels = [f"below {high:g}" if low == 0.0 else f"{low:g} to {high:g}" for low, high in pairwise(budget.edges)]
    axes.set_yticks(places, labels)
    axes.set_xlim(0.0, 100.0)
    unit = entry.wanted.requirement.limit.unit.replace("u", "\N{MICRO SIGN}", 1)
    axes.set_title(f"{entry.model.name}, {entry.case}: RMS {entry.rms:.3g} {unit}")


def _mark_resonances(axes: Axes, entries: Sequence[SignalBudget]) -> None:
    """Resonances with a share in one of the active budgets; those at nearly the same frequency once."""
    marked = [
        each
        for entry in entries
        if entry.case == "active"
        for each, part in zip(entry.budget.resonances, entry.budget.by_resonance, strict=False)
        if entry.budget.share(float(part)) > LEAST_SHARE
    ]
    shown = 0.0  # Hz
    for each in sorted(marked, key=lambda each: each.modes):
        if each.modes[0] > 1.1 * shown:
            shown = each.modes[-1]
            axes.axvspan(each.low, each.high, color=REFERENCE, alpha=0.15, lw=0.0)
            axes.annotate(
                each.name, (each.high, 0.01), xycoords=("data", "axes fraction"), rotation=90, fontsize=10,
                ha="left", va="bottom", color=REFERENCE,
            )  # fmt: skip
