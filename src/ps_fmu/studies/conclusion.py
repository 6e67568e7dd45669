"""What a finished study says, on the terminal, in summary.json and in study.html, where its cases can be explored."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import msgspec
import numpy as np

from ..pointing.confidence import Statement
from ..requirements.requirement import read_requirements
from ..requirements.verdict import Answer
from ..results.page.cases import CaseColumn, CaseTable, Mark
from ..results.page.content import Exploration
from ..results.report import Report
from ..results.summary import FmuFile, plain, versions
from ..results.tables import Table
from ..slavekit.pack.files import write_atomically
from .factors import Factor
from .figures import draw_all
from .outcome import (
    CONFIDENCE,
    PROBABILITIES,
    Compliance,
    Influence,
    Outcome,
    Output,
    Percentiles,
    collect,
    count_statuses,
    find_compliance,
    find_failed,
    find_influences,
    find_percentiles,
    find_worst,
)
from .preparation import list_columns
from .rows import SIGNALS, list_stored
from .study import LATIN, SAMPLES, SOBOL
from .sweep import Prepared, SweepOptions

WORST_SHOWN = 1000  # of a study that is too large for the page: these are there in any case
MOST_METRICS = 60
CAPTION = (
    "Each point is a case. Blue: up to the limit of the requirement, or without a limit; orange: above it. Dashed "
    "lines in the distribution are percentiles over all cases. The filter takes the number of a case, or a condition "
    "such as mass > 51 on a column of the table, in its unit."
)
SUMMARY, REPORT = "summary.json", "study.html"
MOST_ROWS = 40  # of a table on the page; all are in summary.json
STRONGEST = 5  # factors in a row of the ranking


def tabulate_cases(
    outcome: Outcome, percentiles: Sequence[Percentiles], influences: Sequence[Influence], command: tuple[str, str]
) -> CaseTable | None:
    """All cases; None where none has a number.

    ``command``: the texts before and after the number of a case in the command that runs it again.
    """
    stated = {one.output.name: one for one in percentiles}
    strengths = {one.output.name: one for one in influences}
    shown = list(dict.fromkeys([*outcome.headlines, *outcome.outputs]))
    metrics = [
        _make_metric(outcome, output, stated[output.name], strengths.get(output.name))
        for output in shown if output.name in stated
    ][:MOST_METRICS]  # fmt: skip
    if not metrics:
        return None
    parameters = [_make_parameter(factor, outcome, place) for place, factor in enumerate(outcome.plan.factors)]
    measures = influences[0].measures if influences else {}
    names = {"sobol_total": "total Sobol\u2019 index", "morris_mu_star": "Morris\u2019 mean magnitude"}
    return CaseTable(
        "Cases",
        CAPTION,
        parameters,
        metrics,
        next((text for name, text in names.items() if name in measures), "rank correlation"),
        command,
        {case: f"{status}: {error.splitlines()[0] if error else ''}" for case, status, error in find_failed(outcome)},
        [case for case, _, _ in find_worst(outcome, WORST_SHOWN)],
    )


def _make_parameter(factor: Factor, outcome: Outcome, place: int) -> CaseColumn:
    texts = [level for level in factor.levels if isinstance(level, str)]
    return CaseColumn(factor.name, factor.unit, outcome.plan.draws[:, place], texts)


def _make_metric(outcome: Outcome, output: Output, stated: Percentiles, influence: Influence | None) -> CaseColumn:
    marks = [Mark(f"{100.0 * (one.probability or 0.0):g} %", one.value) for one in stated.stated]
    ranking: list[float] = []
    if influence is not None:
        values = next(
            (influence.measures[name] for name in ("sobol_total", "morris_mu_star") if name in influence.measures),
            influence.rank_correlation,
        )
        ranking = np.asarray(values, dtype=float).tolist()
    return CaseColumn(output.title, output.unit, outcome.values(output), (), output.limit, marks, ranking)


@dataclass(frozen=True, eq=False)
class Conclusion:
    """The statistics of a study."""

    outcome: Outcome
    percentiles: Sequence[Percentiles]
    compliance: Sequence[Compliance]
    influences: Sequence[Influence]


def conclude(options: SweepOptions, prepared: Prepared, folder: Path) -> str:
    """Write ``study.parquet``, summary.json, figures and study.html; the text for the terminal.  Raises ``OSError``."""
    study = prepared.plan.study
    requirements = () if study.requirements is None else read_requirements(study.requirements)
    columns = list_columns(prepared.plan.study, prepared.system)
    outcome = collect(folder, prepared.plan, prepared.identity.plan_sha256, columns, requirements)
    found = Conclusion(
        outcome, find_percentiles(outcome), find_compliance(outcome), find_influences(outcome)
    )
    tables = make_tables(found, options)
    notes = [*list_notes(found), *describe_signals(folder)]
    warnings = [*list_warnings(found), *prepared.system.warnings.texts]
    content = plain(summarise(found, prepared, options), "summary")
    write_atomically(folder / SUMMARY, json.dumps(content, indent=2, allow_nan=False) + "\n")
    shown = tabulate_cases(outcome, found.percentiles, found.influences, split_command(options))
    Report(
        title=study.name,
        text=[describe_study(found), *notes],
        warnings=warnings,
        tables=tables,
        explored=Exploration(cases=shown),
        pictures=draw_all(outcome, folder, found.percentiles, found.influences),
        parameters=describe_parameters(outcome),
        fmus=[FmuFile(name, sha256) for name, sha256 in prepared.identity.fmus.items()],
        versions=versions(),
    ).write(folder / REPORT)
    texts = [f"{table.caption}\n{table.to_text()}" for table in tables]
    return "\n\n".join([describe_study(found), *texts, *notes, *warnings, f"results in {folder}"])


def split_command(options: SweepOptions) -> tuple[str, str]:
    """The command that runs a case again, with all signals and a report: before and after the number of the case."""
    words = ["--output", str(options.output), *([] if options.fmus is None else ["--fmus", str(options.fmus)])]
    return shlex.join(["ps-fmu", "sweep", str(options.study), "--case"]) + " ", " " + shlex.join(words)


def command_of_case(options: SweepOptions, case: int) -> str:
    """The command that runs a case again."""
    return str(case).join(split_command(options))


def describe_study(found: Conclusion) -> str:
    """What was done, in a sentence or two."""
    plan, study = found.outcome.plan, found.outcome.plan.study
    counts = count_statuses(found.outcome)
    states = ", ".join(f"{count} {status}" for status, count in counts.items())
    runs = f" of {len(study.runs)} runs ({', '.join(study.runs)})" if len(study.runs) > 1 else ""
    return (
        f"{len(plan)} cases{runs} of {study.duration_s:g} s, plan {study.plan!r}, {len(plan.factors)} varied, "
        f"seed {study.seed}: {states}."
    )


def describe_signals(folder: Path) -> list[str]:
    """Where signals are, if some are stored."""
    cases = list(list_stored(folder))
    if not cases:
        return []
    named = ", ".join(map(str, cases[:20])) + (" ..." if len(cases) > 20 else "")
    what = f"{len(cases)} cases are" if len(cases) > 1 else "one case are"
    return [f"Signals of {what} in the folder {SIGNALS}: {named}."]


def list_notes(found: Conclusion) -> list[str]:
    """How to read the tables."""
    plan = found.outcome.plan.study.plan
    if plan not in SAMPLES:
        return [
            f"The plan {plan!r} is no sample of the dispersed system: percentiles and shares are those of its points, "
            "not probabilities."
        ]
    if plan in (LATIN, SOBOL):
        return [
            "Intervals are those of independent cases. The points of this plan are spread more evenly, so the "
            "intervals are rather too wide."
        ]
    return []


def list_warnings(found: Conclusion) -> list[str]:
    """What should make the reader careful."""
    failed = len(found.outcome.table) - int(found.outcome.done.sum())
    return [f"{failed} cases have no result: they count as not meeting any requirement."] if failed else []


def make_tables(found: Conclusion, options: SweepOptions) -> list[Table]:
    """The tables of terminal and page; empty ones are left out."""
    tables = [
        _tabulate_compliance(found.compliance),
        _tabulate_worst(found.outcome, options),
        _tabulate_failed(found.outcome, options),
        _tabulate_percentiles(found),
        _tabulate_ranking(found),
    ]
    return [table for table in tables if table.rows]


def _tabulate_compliance(compliance: Sequence[Compliance]) -> Table:
    rows = []
    for one in compliance:
        low, high = one.below.interval()
        rows.append((
            one.output.title, f"{one.output.limit:g} {one.output.unit}",
            f"{one.below.true} of {one.below.cases}", f"{one.below.value:.4g}", f"{low:.4g} to {high:.4g}",
            f"{one.sure.true} of {one.sure.cases}", _describe_pooled(one),
        ))  # fmt: skip
    header = ("requirement", "limit", "met", "probability", f"{100 * CONFIDENCE:g} % interval",
              "met with its confidence", "over all cases")  # fmt: skip
    if all(row[-1] == "-" for row in rows):
        header, rows = header[:-1], [row[:-1] for row in rows]  # type: ignore[assignment, misc]
    return Table("Probability of meeting each requirement (Clopper-Pearson)", header, rows)


def _describe_pooled(one: Compliance) -> str:
    """The statement over all cases, and whether the requirement is met."""
    stated = one.pooled
    if stated is None or one.answer is None:
        return "-"
    answer = "NOT MET" if one.answer is Answer.NOT_MET else one.answer.value
    if stated.ensemble_share is None:
        return f"{answer}: {stated}"
    share = f"{100.0 * stated.ensemble_share:.4g} % of all possible cases are no worse"
    return f"{answer}: {stated.value:.4g} in the worst case; {share}, with {100.0 * stated.confidence:g} % confidence"


def _tabulate_worst(outcome: Outcome, options: SweepOptions) -> Table:
    rows = [
        (str(case), f"{value:.4g} {output.unit}", output.title, command_of_case(options, case))
        for case, value, output in find_worst(outcome)
    ]
    return Table("Worst cases", ("case", "value", "output", "run it again"), rows)


def _tabulate_failed(outcome: Outcome, options: SweepOptions) -> Table:
    rows = [
        (str(case), status, error.splitlines()[0] if error else "", command_of_case(options, case))
        for case, status, error in find_failed(outcome)[:MOST_ROWS]
    ]
    return Table("Cases without a result", ("case", "status", "error", "run it again"), rows)


def _tabulate_percentiles(found: Conclusion) -> Table:
    shown = {output.name for output in found.outcome.headlines}
    rows: list[tuple[str, ...]] = []
    for one in found.percentiles:
        if one.output.name in shown and len(rows) < MOST_ROWS:
            cells = [
                f"{stated.value:.4g}" + (f" ({stated.lower:.4g} to {stated.upper:.4g})" if _is_bounded(stated) else "")
                for stated in one.stated
            ]
            rows.append((one.output.title, one.output.unit, f"{one.mean:.4g}", f"{one.std:.3g}", *cells,
                         f"{one.largest:.4g}"))  # fmt: skip
    header = ("output", "unit", "mean", "std", *(f"{100 * p:g} %" for p in PROBABILITIES), "largest")
    return Table(f"Percentiles over the cases, with {100 * CONFIDENCE:g} % intervals", header, rows)


def _tabulate_ranking(found: Conclusion) -> Table:
    shown = {output.name for output in found.outcome.headlines}
    names = [factor.name for factor in found.outcome.plan.factors]
    rows: list[tuple[str, ...]] = []
    for influence in found.influences:
        if influence.output.name in shown and len(rows) < MOST_ROWS:
            order = influence.strength.argsort()[::-1][:STRONGEST]
            rows.append((influence.output.title, ", ".join(_describe_influence(influence, names, i) for i in order)))
    return Table("What the outputs depend on, the strongest first", ("output", _name_measure(found)), rows)


def summarise(found: Conclusion, prepared: Prepared, options: SweepOptions) -> dict[str, object]:
    """The content of summary.json."""
    names = [factor.name for factor in found.outcome.plan.factors]
    return {
        "study": found.outcome.plan.study.name,
        "identity": msgspec.structs.asdict(prepared.identity),
        "statuses": count_statuses(found.outcome),
        "confidence": CONFIDENCE,
        "requirements": [
            {
                "requirement": one.output.requirement and one.output.requirement.name, "run": one.output.run,
                "signal": one.output.signal, "limit": one.output.limit, "unit": one.output.unit,
                "cases": one.below.cases, "met": one.below.true, "probability": one.below.value,
                "interval": one.below.interval(), "met_with_confidence": one.sure.true,
                "interpretation": one.output.requirement and one.output.requirement.interpretation.value,
                "over_all_cases": None if one.pooled is None else {**asdict(one.pooled), "verdict": one.answer},
            }
            for one in found.compliance
        ],
        "outputs": {
            one.output.name: {
                "unit": one.output.unit, "cases": one.cases, "mean": one.mean, "std": one.std, "least": one.least,
                "largest": one.largest,
                "percentiles": [
                    {"probability": s.probability, "value": s.value, "lower": s.lower, "upper": s.upper,
                     "bound": s.bound} for s in one.stated
                ],
            }
            for one in found.percentiles
        },
        "worst": [
            {"case": case, "output": output.name, "value": value, "command": command_of_case(options, case)}
            for case, value, output in find_worst(found.outcome)
        ],
        "failed": [
            {"case": case, "status": status, "error": error} for case, status, error in find_failed(found.outcome)
        ],
        "sensitivity": {
            influence.output.name: {
                "rank_correlation": dict(zip(names, influence.rank_correlation.tolist(), strict=True)),
                **{name: dict(zip(names, values.tolist(), strict=True)) for name, values in influence.measures.items()},
            }
            for influence in found.influences
        },
        "versions": versions(),
    }  # fmt: skip


def describe_parameters(outcome: Outcome) -> dict[str, object]:
    """What the page says of the plan."""
    found: dict[str, object] = {}
    for factor in outcome.plan.factors:
        spread = factor.spread
        if spread is None:
            text = ", ".join(map(str, factor.levels[:10])) + (" ..." if len(factor.levels) > 10 else "")
        elif spread.sigma:
            text = f"normal, mean {spread.mean:g}, sigma {spread.sigma:g}"
            if math.isfinite(spread.low) or math.isfinite(spread.high):
                text += f", from {spread.low:g} to {spread.high:g}"
        else:
            text = f"uniform, from {spread.low:g} to {spread.high:g}"
        found[factor.name] = f"{text} {factor.unit}; sets {', '.join(factor.targets)}"
    return found


def _is_bounded(stated: Statement) -> bool:
    return math.isfinite(stated.lower) and math.isfinite(stated.upper)


def _name_measure(found: Conclusion) -> str:
    measures = found.influences[0].measures if found.influences else {}
    if "sobol_total" in measures:
        return "total Sobol' index (first order)"
    return "Morris' mean magnitude" if "morris_mu_star" in measures else "rank correlation"


def _describe_influence(influence: Influence, names: Sequence[str], i: int) -> str:
    if "sobol_total" in influence.measures:
        total, first = (influence.measures[name][i] for name in ("sobol_total", "sobol_first"))
        return f"{names[i]} {total:.2f} ({first:.2f})"
    if "morris_mu_star" in influence.measures:
        return f"{names[i]} {influence.measures['morris_mu_star'][i]:.3g}"
    return f"{names[i]} {influence.rank_correlation[i]:+.2f}"
