"""What a finished study says, on the terminal, in summary.json, as figures, and in study.html to explore."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import asdict
from pathlib import Path

import msgspec

from ..files.plain import write_atomically
from ..pointing.confidence import Statement
from ..requirements.requirement import read_requirements
from ..requirements.verdict import Answer
from ..results.page.cases import CaseColumn, CaseTable, Mark
from ..results.page.content import Exploration
from ..results.report import Report
from ..results.summary import FmuFile, plain, versions
from ..results.tables import Table, wrap_text
from .case_figures import SHARE, draw_all
from .outcome import (
    CONFIDENCE,
    PROBABILITIES,
    Compliance,
    Outcome,
    Output,
    collect,
    count_statuses,
    find_failed,
    find_worst,
)
from .preparation import list_columns
from .rows import SIGNALS, list_reasons, list_stored
from .study import LATIN, LIST, MORRIS, SAMPLES, SOBOL, SOBOL_INDICES
from .sweep import Prepared, SweepOptions

EFFECT = "mean magnitude mu* of the elementary effects"
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


def tabulate_cases(outcome: Outcome, command: tuple[str, str]) -> CaseTable | None:
    """All cases; None where none has a number.

    ``command``: the texts before and after the number of a case in the command that runs it again.
    """
    stated = {one.output.name: one for one in outcome.percentiles}
    shown = [output for output in dict.fromkeys([*outcome.headlines, *outcome.outputs]) if output.name in stated]
    if not shown:
        return None
    parameters = [
        CaseColumn(factor.name, unit, scale * draws, [level for level in factor.levels if isinstance(level, str)])
        for factor, draws in zip(outcome.plan.factors, outcome.plan.draws.T, strict=True)
        for unit, scale in [factor.shown]
    ]
    metrics = [
        CaseColumn(
            output.title, output.unit, outcome.values(output), (), output.limit,
            [Mark(f"{100.0 * (one.probability or 0.0):g} %", one.value) for one in stated[output.name].stated],
            *_rank_factors(outcome, output),
        )
        for output in shown[:MOST_METRICS]
    ]  # fmt: skip
    failed = {case: f"{status}: {' '.join(error.split())}" for case, status, error in find_failed(outcome)}
    worst = [case for case, _, _ in find_worst(outcome, WORST_SHOWN)]
    measure = EFFECT if outcome.plan.study.plan == MORRIS else SHARE
    return CaseTable("Cases", CAPTION, parameters, metrics, measure, command, failed, worst)


def _rank_factors(outcome: Outcome, output: Output) -> tuple[list[float], list[str], str]:
    """What factors are ranked by, the same in words, and what is left; nothing where the output does not vary."""
    influence = outcome.influences.get(output.name)
    if influence is None:
        return [], [], ""
    places = range(len(outcome.plan.factors))
    texts = [influence.describe(place, output.unit) or influence.describe_floor() for place in places]
    return [influence.strength(place) for place in places], texts, influence.describe_left(outcome.plan)


def conclude(options: SweepOptions, prepared: Prepared, folder: Path) -> str:
    """Write ``study.parquet``, summary.json, figures and study.html; the text for the terminal.  Raises ``OSError``."""
    study = prepared.plan.study
    requirements = () if study.requirements is None else read_requirements(study.requirements)
    columns = list_columns(study, prepared.system)
    outcome = collect(folder, prepared.plan, prepared.identity.plan_sha256, columns, requirements)
    about, tables = describe_study(outcome), make_tables(outcome)
    again = f"To run case N again, with all signals and a report:\n  {'N'.join(split_command(options))}"
    notes = [*list_notes(outcome), *describe_signals(folder)]
    warnings = [*list_warnings(outcome), *prepared.system.warnings.texts]
    content = plain(summarise(outcome, prepared, options), "summary")
    write_atomically(folder / SUMMARY, json.dumps(content, indent=2, allow_nan=False) + "\n")
    cases = tabulate_cases(outcome, split_command(options))
    headlines = len({one.output.name for one in outcome.percentiles} & {one.name for one in outcome.headlines})
    Report(
        title=study.name,
        text=[about, *notes, again],
        warnings=warnings,
        tables=tables,
        explored=Exploration(cases=cases),
        pictures=[] if cases is None else draw_all(cases, headlines, folder),
        parameters=describe_parameters(outcome),
        fmus=[FmuFile(name, sha256) for name, sha256 in prepared.identity.fmus.items()],
        versions=versions(),
    ).write(folder / REPORT)
    texts = [f"{wrap_text(table.caption)}\n{table.to_text()}" for table in tables]
    said = map(wrap_text, (*notes, *warnings))
    return "\n\n".join([wrap_text(about), *texts, *said, again, f"results in {folder}"])


def split_command(options: SweepOptions) -> tuple[str, str]:
    """The command that runs a case again, with all signals and a report: before and after the number of the case."""
    words = ["--output", str(options.output), *([] if options.fmus is None else ["--fmus", str(options.fmus)])]
    words += options.replacements
    return shlex.join(["ps-fmu", "sweep", str(options.study), "--case"]) + " ", " " + shlex.join(words)


def command_of_case(options: SweepOptions, case: int) -> str:
    """The command that runs a case again."""
    return str(case).join(split_command(options))


def describe_study(outcome: Outcome) -> str:
    """What was done, in a sentence or two."""
    plan, study = outcome.plan, outcome.plan.study
    counts = count_statuses(outcome)
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


def list_notes(outcome: Outcome) -> list[str]:
    """How to read the tables."""
    plan, study = outcome.plan, outcome.plan.study
    notes = []
    if not outcome.is_sample:
        notes.append(
            f"The plan {study.plan!r} is no sample of the dispersed system: shares and percentiles are those of its "
            "points. There is no probability of meeting a requirement and no statement over all cases: plans that "
            f"sample have them, {', '.join(SAMPLES)}."
        )
    elif study.plan in (LATIN, SOBOL) or study.correlations:
        notes.append(
            "Intervals are those of independent cases. The points of this plan are spread more evenly, so the "
            "intervals are rather too wide."
        )
    if outcome.is_sample and plan.shared_seeds:
        notes.append(
            f"All cases have the same random numbers ({', '.join(plan.shared_seeds)}). Probabilities, intervals and "
            "statements over all cases hold for this one record of noise: the cases are no independent samples of the "
            "ensemble, and an ensemble or mixed requirement gets no verdict over all cases. "
            'To have one, give each case its own: seeds = "independent", and no start value of a seed.'
        )
    if study.plan == MORRIS:
        notes.append(
            "Mean magnitude mu* and standard deviation of the elementary effects are for one standard deviation of the "
            "parameter: of a linear dependence mu* is the standard deviation of the output that the parameter causes."
        )
    if plan.is_noisy and study.plan in (MORRIS, SOBOL_INDICES):
        what = "effects" if study.plan == MORRIS else "total indices"
        notes.append(
            f"There are no {what}: they compare neighbours, which have other random numbers here. They need "
            'seeds = "common".'
        )
    if study.correlations or study.plan == LIST:
        notes.append(
            "Parameters that vary together share what they explain: each one's share of the variance has a part of the "
            "others', and the shares may add up to more than all."
        )
    return notes


def list_warnings(outcome: Outcome) -> list[str]:
    """What should make the reader careful."""
    failed = find_failed(outcome)
    text = f"{len(failed)} cases have no result: they count as not meeting any requirement."
    return ["\n  ".join([text, *list_reasons(failed)])] if failed else []


def make_tables(outcome: Outcome) -> list[Table]:
    """The tables of terminal and page; empty ones are left out."""
    tables = [
        _tabulate_compliance(outcome),
        _tabulate_worst(outcome),
        _tabulate_failed(outcome),
        _tabulate_percentiles(outcome),
        _tabulate_ranking(outcome),
    ]
    return [table for table in tables if table.rows]


def _tabulate_compliance(outcome: Outcome) -> Table:
    rows = []
    for one in outcome.compliance:
        low, high = one.below.interval()
        likely = [f"{one.below.value:.4g}", f"{low:.4g} to {high:.4g}"] if outcome.is_sample else []
        rows.append((
            one.output.title, f"{one.output.limit:g} {one.output.unit}", f"{one.below.true} of {one.below.cases}",
            *likely, f"{one.sure.true} of {one.sure.cases}", _describe_pooled(one),
        ))  # fmt: skip
    likely = ["probability", f"{100 * CONFIDENCE:g} % interval"] if outcome.is_sample else []
    header = ("requirement", "limit", "met", *likely, "met with its confidence", "over all cases")
    if all(row[-1] == "-" for row in rows):
        header, rows = header[:-1], [row[:-1] for row in rows]
    caption = "Probability of meeting each requirement (Clopper-Pearson)"
    return Table(caption if outcome.is_sample else "Points of the plan that meet each requirement", header, rows)


def _describe_pooled(one: Compliance) -> str:
    """The statement over all cases, and whether the requirement is met."""
    stated = one.pooled
    if stated is None:
        return "-"
    if one.answer is None:
        of = "no bound" if math.isinf(stated.bound) else f"below {stated.bound:.4g}"
        return (
            f"no verdict: {stated.value:.4g} ({100.0 * (stated.probability or 0.0):g} % quantile), {of} with "
            f"{100.0 * stated.confidence:g} % confidence, for the one record of noise that all cases have"
        )
    answer = "NOT MET" if one.answer is Answer.NOT_MET else one.answer.value
    if stated.ensemble_share is None:
        return f"{answer}: {stated}"
    share = f"{100.0 * stated.ensemble_share:.4g} % of all possible cases are no worse"
    return f"{answer}: {stated.value:.4g} in the worst case; {share}, with {100.0 * stated.confidence:g} % confidence"


def _tabulate_worst(outcome: Outcome) -> Table:
    worst = find_worst(outcome)
    rows = [(str(case), f"{value:.4g} {output.unit}", output.title) for case, value, output in worst]
    return Table("Worst cases", ("case", "value", "output"), rows)


def _tabulate_failed(outcome: Outcome) -> Table:
    failed = find_failed(outcome)[:MOST_ROWS]
    rows = [(str(case), status) for case, status, _ in failed]
    reasons = [" ".join(error.split()) for *_, error in failed]
    return Table("Cases without a result", ("case", "status"), rows, notes=reasons)


def _tabulate_percentiles(outcome: Outcome) -> Table:
    shown = {output.name for output in outcome.headlines}
    rows: list[tuple[str, ...]] = []
    for one in outcome.percentiles:
        if one.output.name in shown and len(rows) < MOST_ROWS:
            cells = [
                f"{stated.value:.3g}" + (f" ({stated.lower:.3g} to {stated.upper:.3g})" if _is_bounded(stated) else "")
                for stated in one.stated
            ]
            rows.append((one.output.title, one.output.unit, f"{one.mean:.3g}", f"{one.std:.3g}", *cells,
                         f"{one.largest:.3g}"))  # fmt: skip
    header = ("output", "unit", "mean", "std", *(f"{100 * p:g} %" for p in PROBABILITIES), "largest")
    bounded = f", with {100 * CONFIDENCE:g} % intervals" if outcome.is_sample else ""
    return Table(f"Percentiles over the cases{bounded}", header, rows)


def _tabulate_ranking(outcome: Outcome) -> Table:
    rows: list[tuple[str, str, str, str]] = []
    for output in outcome.headlines:
        influence = outcome.influences.get(output.name)
        if influence is None or len(rows) == MOST_ROWS:
            continue
        texts = [(outcome.plan.factors[k].name, influence.describe(k, output.unit)) for k in influence.order]
        said = "; ".join(f"{name} {text}" for name, text in texts[:STRONGEST] if text)
        rows.append((output.title, said or "none", influence.describe_floor(), influence.describe_left(outcome.plan)))
    header = ("output", "the strongest first", "others", "what is left")
    told = [place for place in range(4) if any(row[place] for row in rows)]
    measure = EFFECT if outcome.plan.study.plan == MORRIS else SHARE
    if 2 in told:  # a noise floor; else they are exact
        measure += f", with its {100 * CONFIDENCE:g} % interval"
    return Table(
        f"What the outputs depend on: {measure}", [header[place] for place in told],
        [[row[place] for place in told] for row in rows],
    )  # fmt: skip


def summarise(outcome: Outcome, prepared: Prepared, options: SweepOptions) -> dict[str, object]:
    """The content of summary.json."""
    names = [factor.name for factor in outcome.plan.factors]
    return {
        "study": outcome.plan.study.name,
        "identity": msgspec.structs.asdict(prepared.identity),
        "statuses": count_statuses(outcome),
        "confidence": CONFIDENCE,
        "requirements": [
            {
                "requirement": one.output.requirement and one.output.requirement.name, "run": one.output.run,
                "signal": one.output.signal, "limit": one.output.limit, "unit": one.output.unit,
                "cases": one.below.cases, "met": one.below.true,
                "probability": one.below.value if outcome.is_sample else None,
                "interval": one.below.interval() if outcome.is_sample else None, "met_with_confidence": one.sure.true,
                "interpretation": one.output.requirement and one.output.requirement.interpretation.value,
                "over_all_cases": None if one.pooled is None else {**asdict(one.pooled), "verdict": one.answer},
            }
            for one in outcome.compliance
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
            for one in outcome.percentiles
        },
        "worst": [
            {"case": case, "output": output.name, "value": value, "command": command_of_case(options, case)}
            for case, value, output in find_worst(outcome)
        ],
        "failed": [
            {"case": case, "status": status, "error": error} for case, status, error in find_failed(outcome)
        ],
        "sensitivity": {name: one.as_dict(names) for name, one in outcome.influences.items()},
        "shared_seeds": outcome.plan.shared_seeds,
        "notes": list_notes(outcome),
        "versions": versions(),
    }  # fmt: skip


def describe_parameters(outcome: Outcome) -> dict[str, object]:
    """What the page says of the plan."""
    found: dict[str, object] = {}
    for factor in outcome.plan.factors:
        spread, (unit, scale) = factor.spread, factor.shown
        if spread is None:
            shown = [f"{scale * x:.9g}" if isinstance(x, float) else str(x) for x in factor.levels[:10]]
            text = ", ".join(shown) + (" ..." if len(factor.levels) > 10 else "")
        else:
            text = f"from {scale * spread.low:g} to {scale * spread.high:g}"
            if spread.sigma:
                limits = f", {text}" if math.isfinite(spread.low) or math.isfinite(spread.high) else ""
                text = f"normal, mean {scale * spread.mean:g}, sigma {scale * spread.sigma:g}{limits}"
            else:
                text = f"uniform, {text}"
            if spread.multiple_of:
                text += f", multiples of {scale * spread.multiple_of:g}"
        found[factor.name] = f"{text} {unit}; sets {', '.join(factor.targets)}"
    return found


def _is_bounded(stated: Statement) -> bool:
    return math.isfinite(stated.lower) and math.isfinite(stated.upper)
