"""``ps-fmu analyse budget``: the budgets of the requirements, as sentences, tables, figures and numbers."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from tqdm import tqdm

from ...analyses.options import SYSTEM, AnalysisOptions
from ...analyses.result import AnalysisResult
from ...analyses.system import load_built_system
from ...cosim import System, read_system
from ...pointing.budget import UncertaintyFactors
from ...product.files import find_product
from ...results.report import Picture, draw_pictures
from ...results.tables import Table
from ...runs.built_fmus import provide_fmus
from .plots import draw_bands, draw_cumulative
from .results import CASES, Entry, compute_budgets, describe_band, list_wanted, read_factors, read_with_parameters
from .sources import POINTS
from .system_model import STEP

INSTRUMENT = "Instrument.ssd"
REQUIREMENTS = "requirements.toml"
_LARGEST = 4  # channels of a budget in the table


def analyse(options: AnalysisOptions, points: int = POINTS) -> AnalysisResult:
    """Compute the budgets of the requirements and draw them.

    Of the system of the options; with the product's default system also of its instrument with sensors and coils.
    ``points``: frequencies of a density besides those around the poles.
    """
    factors = read_factors(options.uncertainty)
    systems = read_with_parameters(_read_systems(options), options.parameters)
    path = options.requirements or find_product().system / REQUIREMENTS
    entries: list[Entry] = []
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


def _list_sentences(entries: Sequence[Entry]) -> Iterator[tuple[str, str]]:
    """Of each system and requirement the active target that takes most of its limit."""
    for group in _group(entries):
        worst = max((e for e in group if e.case == "active"), key=_rank)
        yield worst.model.name, f"{worst.sentence}."


def _rank(entry: Entry) -> float:
    return entry.rms / entry.wanted.requirement.limit.value


def _group(entries: Sequence[Entry]) -> list[list[Entry]]:
    """Entries of the same system and requirement."""
    found: dict[tuple[int, str], list[Entry]] = {}
    for entry in entries:
        found.setdefault((id(entry.model), entry.wanted.requirement.name), []).append(entry)
    return list(found.values())


def _tabulate(entries: Sequence[Entry]) -> Iterator[Table]:
    """Of each system: totals, and of the signals that take most of their limits the largest sources and modes."""
    for system in dict.fromkeys(entry.model.name for entry in entries):
        own = [entry for entry in entries if entry.model.name == system]
        worst = [max((e for e in group if e.case == "active"), key=_rank) for group in _group(own)]
        yield _tabulate_totals(system, own)
        yield _tabulate_channels(system, worst)
        yield _tabulate_modes(system, worst)


def _tabulate_totals(system: str, entries: Sequence[Entry]) -> Table:
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


def _tabulate_channels(system: str, entries: Sequence[Entry]) -> Table:
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


def _tabulate_modes(system: str, entries: Sequence[Entry]) -> Table:
    rows = []
    for entry in entries:
        shares = [entry.budget.share(part) for part in entry.budget.by_mode]
        order = np.argsort(-np.abs(shares))[:_LARGEST]
        text = ", ".join(f"{entry.budget.modes[k]}: {100.0 * shares[k]:.1f} %" for k in order)
        rows.append((entry.wanted.requirement.name, entry.wanted.short, text))
    header = ("requirement", "signal", "modes and their shares")
    return Table(f"{system}: the largest modes of the same budgets", header, rows)


def _draw(options: AnalysisOptions, entries: Sequence[Entry]) -> list[Picture]:
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
            (f"bands_{number}", f"{worst.title}: variance by source and band.", partial(draw_bands, entries=shown)),
            (
                f"cumulative_{number}",
                f"{worst.title}: RMS of all below a frequency, and the modes that matter.",
                partial(draw_cumulative, entries=shown),
            ),
        ]
    return draw_pictures(options.output, "budget", figures)


def _describe(entry: Entry) -> dict[str, object]:
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
