"""Whether a requirement is met, with its margin; as a row of a table, as an entry of summary.json, in words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from enum import StrEnum

from ..pointing.confidence import MARKOV, Statement
from ..pointing.interpretation import Interpretation
from ..results.tables import Table, format_tables
from .decision import advise, state
from .record import RequirementRecord
from .requirement import Requirement


class Answer(StrEnum):
    """The answer to a requirement; only the first answer counts as met."""

    MET = "met"
    NOT_MET = "not met"
    """Shown to be above the limit."""
    NOT_SHOWN = "not shown"
    """The limit lies within the interval of the value."""
    OPEN = "cannot be said"


@dataclass(frozen=True)
class Verdict:
    """The answer to a requirement for one signal of one run, or of several runs that are judged together."""

    requirement: Requirement
    case: str
    signal: str
    answer: Answer
    limit: float
    """In the unit of the signal."""
    statement: Statement | None
    """In the unit of the signal; None where there was nothing to judge."""
    remark: str = ""
    """Why there is no answer, or how to get a closer bound."""
    rows: str = ""
    """Which rows were judged, of which bandwidth."""

    @property
    def met(self) -> bool:
        """True only if the answer is "met"."""
        return self.answer is Answer.MET

    @property
    def margin_percent(self) -> float | None:
        """Margin 100 (1 - bound / limit), %; negative if the bound exceeds the limit, None without a bound."""
        if self.statement is None or not math.isfinite(self.statement.bound):
            return None
        return 100.0 * (1.0 - self.statement.bound / self.limit)

    def convert(self, value: float) -> float:
        """Convert a value from the unit of the signal to the unit of the limit."""
        return value / self.limit * self.requirement.limit.value

    def as_dict(self) -> dict[str, object]:
        """Return the entry of summary.json: numbers in the unit of the limit, margin in percent."""
        stated = self.statement
        index = self.requirement.index
        return {
            "requirement": self.requirement.name,
            "case": self.case,
            "signal": self.signal,
            "index": index.symbol,
            **{item.name: getattr(index, item.name) for item in fields(index)},  # type: ignore[arg-type]
            "settling": self.requirement.settling_s,
            "statistic": self.requirement.statistic,
            "probability": self.requirement.probability,
            "confidence": self.requirement.confidence,
            "interpretation": None if self.requirement.confidence is None else self.requirement.interpretation.value,
            "limit": self.requirement.limit.value,
            "unit": self.requirement.limit.unit,
            "value": None if stated is None else self.convert(stated.value),
            "bound": None if stated is None else self.convert(stated.bound),
            "independent_samples": None if stated is None else stated.independent,
            "ensemble_share": None if stated is None else stated.ensemble_share,
            "method": None if stated is None else stated.method,
            "margin": self.margin_percent,
            "verdict": self.answer.value,
            "met": self.met,
            "remark": self.remark,
            "rows": self.rows,
        }

    @property
    def value(self) -> str:
        """The value in the unit of the limit as text without the unit; ``-`` if there is none."""
        return self._show(None if self.statement is None else self.statement.value)

    @property
    def bound(self) -> str:
        """The bound in the unit of the limit as text without the unit; ``-`` if there is none."""
        return self._show(None if self.statement is None else self.statement.bound)

    @property
    def margin(self) -> str:
        """The margin as text, in percent; for a bound above twice the limit the bound over the limit."""
        return "-" if self.margin_percent is None else format_margin(self.margin_percent)

    def _show(self, value: float | None) -> str:
        return "-" if value is None or not math.isfinite(value) else f"{self.convert(value):.4g}"

    def as_row(self) -> tuple[str, ...]:
        """Return the row of the table under :data:`HEADER`."""
        answer = self.answer.value if self.met else self.answer.value.upper()
        limit = str(self.requirement.limit)
        return self.requirement.name, answer, self.signal, self.case, self.value, self.bound, limit, self.margin


CONSTANT = "the value is the same at all times, and no run is long enough for its quantile: require its peak."
LEAST_MARGIN = -100.0  # percent; of what is less a factor says more


def format_margin(percent: float) -> str:
    """A margin, percent, as a text, such as ``23.1 %``, or ``12.5 x limit`` where the bound is far above the limit."""
    times = float(f"{1.0 - 0.01 * percent:.2g}")
    return f"{percent:.1f} %" if percent >= LEAST_MARGIN else f"{times:g} x limit"


HEADER = ("requirement", "verdict", "signal", "run", "value", "bound", "limit", "margin")
SIGNAL = HEADER.index("signal")


def decide(stated: Statement, limit: float) -> Answer:
    """Met where the bound is not above the limit, not met where the lower end of the interval is; both in one unit."""
    if stated.bound <= limit:
        return Answer.MET
    if stated.lower > limit:
        return Answer.NOT_MET
    return Answer.NOT_SHOWN if math.isfinite(stated.bound) else Answer.OPEN


def judge(requirement: Requirement, case: str, runs: Sequence[RequirementRecord], rows: str) -> list[Verdict]:
    """The verdicts on a requirement, one for each of its targets.

    ``runs``: the records of independent runs of the case, one at least.  ``rows`` says which rows they saw.
    """
    verdicts = []
    filled = [run.distributions for run in runs if run.distributions]
    judged_s = min(run.judged_s for run in runs)
    for place, target in enumerate(runs[0].targets):
        if len(filled) < len(runs):
            why = f"a run ends before one window of {requirement.index.symbol} is full: run longer."
            verdicts.append(Verdict(requirement, case, target.label, Answer.OPEN, target.limit, None, why, rows))
            continue
        stated = state(requirement, [distributions[place] for distributions in filled])
        answer, why = decide(stated, target.limit), ""
        if answer in (Answer.NOT_SHOWN, Answer.OPEN):
            constant = all(found[place].is_constant for found in filled)
            if constant and requirement.interpretation is Interpretation.TEMPORAL:  # others want more runs
                why = CONSTANT
            elif answer is Answer.OPEN:
                why = f"there is no bound. {advise(requirement, stated, len(runs), judged_s)}"
            else:
                side = "below" if stated.value <= target.limit else "above"
                advice = advise(requirement, stated, len(runs), judged_s)
                why = f"the value is {side} the limit, and the limit is within its interval. {advice}"
        elif answer is Answer.MET and stated.method.startswith(MARKOV):
            why = f"the bound is wide, by {MARKOV}. {advise(requirement, stated, len(runs), judged_s)}"
        verdicts.append(Verdict(requirement, case, target.label, answer, target.limit, stated, why, rows))
    return verdicts


def no_run(requirement: Requirement, cases: Sequence[str]) -> Verdict:
    """The verdict where none of the runs, ``cases``, has the name that the requirement asks for."""
    wanted, there = " or ".join(requirement.cases), ", ".join(cases) or "none"
    remark = f"there is no run {wanted}; there are: {there}"
    signal = ", ".join(requirement.signals)
    return Verdict(requirement, wanted, signal, Answer.OPEN, requirement.limit.value, None, remark)


def make_table(verdicts: Sequence[Verdict]) -> Table:
    """All verdicts as a table, numbers in the unit of the limit; below a verdict its remark."""
    remarks = [verdict.remark[:1].upper() + verdict.remark[1:] for verdict in verdicts]
    rows = [verdict.as_row() for verdict in verdicts]
    header, owners = list(HEADER), {row[SIGNAL].strip("|").partition(".")[0] for row in rows if "." in row[SIGNAL]}
    if len(owners) == 1 and "," not in "".join(row[SIGNAL] for row in rows):  # said once, and lines stay short
        (owner,) = owners
        header[SIGNAL] = f"{header[SIGNAL]} of {owner}"
        rows = [(*row[:SIGNAL], row[SIGNAL].replace(f"{owner}.", "", 1), *row[SIGNAL + 1 :]) for row in rows]
    return Table(f"Requirements: {summarise(verdicts)}", header, rows, remarks)


def list_remarks(verdicts: Sequence[Verdict]) -> list[str]:
    """What each requirement is about, and which rows were judged, equal texts once."""
    said = [f"{v.requirement.name}: {v.requirement.about}; {v.requirement.level}." for v in verdicts]
    said += [f"{verdict.case}: judged from {verdict.rows}." for verdict in verdicts if verdict.rows]
    return list(dict.fromkeys(said))


def format_verdicts(verdicts: Sequence[Verdict]) -> str:
    """Table and remarks for a terminal."""
    return format_tables([make_table(verdicts)], list_remarks(verdicts))


def summarise(verdicts: Sequence[Verdict]) -> str:
    """How many are met, for example ``2 of 3 are met, 1 cannot be said``."""
    return count_answers([verdict.answer for verdict in verdicts])


def count_answers(found: Sequence[Answer]) -> str:
    """How many answers are which, in the words of :func:`summarise`."""
    counts = {answer: found.count(answer) for answer in Answer}
    text = f"{counts[Answer.MET]} of {len(found)} are met"
    missed = [f"{counts[answer]} {answer}" for answer in list(Answer)[1:] if counts[answer]]
    return ", ".join([text, *missed])
