"""The rows of a study with its plan, and what they say: percentiles, probabilities, worst cases, sensitivities."""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column
from ..pointing.confidence import Statement, quantile
from ..pointing.interpretation import Interpretation, quantile_of_peaks
from ..requirements.decision import Pool
from ..requirements.requirement import Requirement, find_targets
from ..requirements.verdict import Answer, decide
from .bundle import PLAN
from .observed import find_signals, label_index
from .plan import Plan
from .rows import ANSWER, DONE, HISTOGRAM, VERDICT, RowStore, write_durably
from .sensitivity import Influence, find_influences
from .study import SAMPLES

Array = NDArray[np.float64]

STUDY = "study.parquet"  # in the output folder
PROBABILITIES = (0.05, 0.5, 0.95, 0.99)
CONFIDENCE = 0.9
"""Of the interval of each percentile and probability."""
WORST = 5


@dataclass(frozen=True)
class Output:
    """A number of each row that statistics are made of."""

    name: str
    """Of its column."""
    unit: str
    limit: float | None = None
    """Of the requirement that it belongs to, in ``unit``."""
    requirement: Requirement | None = None
    run: str = ""
    signal: str = ""

    @property
    def title(self) -> str:
        """Short, for tables and figures."""
        if self.requirement is not None:
            return f"{self.requirement.name}: {self.signal}, {self.run}"
        return self.name


@dataclass(frozen=True, eq=False)
class Outcome:
    """All rows of a finished study."""

    plan: Plan
    table: Any
    """``pandas.DataFrame``, a row a case: draws and start values, status, metrics."""
    outputs: tuple[Output, ...]
    """All numbers with statistics: those of requirements first."""
    pooled: Mapping[str, Statement] = field(default_factory=dict)
    """Quantiles of the values of all cases at all times, by the name of the output, for mixed requirements."""

    @property
    def done(self) -> NDArray[np.bool_]:
        """(cases,), whether each has its numbers."""
        return np.asarray(self.table["status"] == DONE)

    def values(self, output: Output) -> Array:
        """(cases,), in the unit of the output; NaN where a case has none."""
        if output.name not in self.table:
            return np.full(len(self.table), np.nan)
        return np.asarray(self.table[output.name].to_numpy(dtype=float, na_value=np.nan))

    @property
    def is_sample(self) -> bool:
        """Whether the cases are a sample of the dispersed system, so that shares of them are probabilities."""
        return self.plan.study.plan in SAMPLES

    @cached_property
    def percentiles(self) -> list[Percentiles]:
        """Of all outputs that some case has."""
        return find_percentiles(self)

    @cached_property
    def compliance(self) -> list[Compliance]:
        """Of each requirement, signal and run."""
        return find_compliance(self)

    @cached_property
    def influences(self) -> dict[str, Influence]:
        """Of the factors on the outputs that vary, by name."""
        found = find_influences(self.plan, np.array([self.values(output) for output in self.outputs]))
        return {output.name: one for output, one in zip(self.outputs, found, strict=True) if one is not None}

    @property
    def headlines(self) -> tuple[Output, ...]:
        """What figures show: the outputs of requirements; without requirements, the RMS of all that is observed."""
        required = tuple(output for output in self.outputs if output.requirement is not None)
        return required or tuple(output for output in self.outputs if output.name.endswith(".rms"))


def collect(folder: Path, plan: Plan, plan_hash: str, columns: Sequence[Column],
            requirements: Sequence[Requirement]) -> Outcome:  # fmt: skip
    """Join plan and rows, and write them as ``study.parquet``; all cases are there.  Raises ``OSError``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    planned = pq.read_table(folder / PLAN)
    store = RowStore(folder, plan_hash)
    rows = store.read_table()
    outputs = list_outputs(plan, columns, requirements)
    units = {output.name: output.unit for output in outputs}
    fields, arrays = list(planned.schema), list(planned.columns)
    for column, array in zip(rows.schema, rows.columns, strict=True):
        if column.name != "case":
            unit = units.get(column.name)
            fields.append(column if unit is None else column.with_metadata({"unit": unit}))
            arrays.append(array)
    joined = pa.table(arrays, schema=pa.schema(fields))
    content = io.BytesIO()
    pq.write_table(joined, content)
    write_durably(folder / STUDY, content.getvalue())
    return Outcome(plan, joined.to_pandas(), outputs, pool_cases(store, outputs, len(plan)))


def pool_cases(store: RowStore, outputs: Sequence[Output], cases: int) -> dict[str, Statement]:
    """The quantile over all times of all cases of each mixed requirement, by the name of its output.

    None where a case has no result: what it would have had is not known.  Raises ``OSError``.
    """
    found = {}
    for output in outputs:
        requirement = output.requirement
        if requirement is None or requirement.interpretation is not Interpretation.MIXED:
            continue
        assert requirement.probability is not None and requirement.confidence is not None and output.limit is not None
        pool = Pool(output.limit, cases)
        for text in store.read_texts(output.name.removesuffix("/value") + HISTOGRAM):
            pool.add(text)
        if pool.runs == cases:
            found[output.name] = pool.state(requirement.probability, requirement.confidence)
    return found


def list_outputs(plan: Plan, columns: Sequence[Column], requirements: Sequence[Requirement]) -> tuple[Output, ...]:
    """The numbers of a row that have statistics: values of requirements, then RMS and peak of what is observed."""
    found = []
    for requirement in requirements:
        for run in plan.study.runs:
            if requirement.judges(run):
                for target in find_targets(requirement, columns):
                    name = f"{VERDICT}{requirement.name}/{run}/{target.label}/value"
                    limit = requirement.limit
                    found.append(Output(name, limit.unit, limit.value, requirement, run, target.label))
    for run in plan.study.runs:
        for observed in plan.study.observed:
            for signal, place in find_signals(observed, columns).items():
                for index in observed.indices:
                    stem = f"{run}.{signal}.{label_index(index)}"
                    found += [
                        Output(f"{stem}.{end}", columns[place].unit, run=run, signal=signal) for end in ("rms", "peak")
                    ]
    return tuple(found)


@dataclass(frozen=True)
class Percentiles:
    """Of an output over the cases, in its unit."""

    output: Output
    cases: int
    """That have a value."""
    mean: float
    std: float
    least: float
    largest: float
    stated: tuple[Statement, ...]
    """One for each of :data:`PROBABILITIES`, by order statistics of independent cases; of a plan that is no sample
    without an interval."""


@dataclass(frozen=True)
class Share:
    """Cases of which something is true: the share with its exact interval (C. J. Clopper, E. S. Pearson, 1934)."""

    true: int
    cases: int

    @property
    def value(self) -> float:
        """Share of the cases."""
        return self.true / self.cases

    def interval(self, confidence: float = CONFIDENCE) -> tuple[float, float]:
        """Two-sided, conservative: it holds the true probability with ``confidence`` at least."""
        from scipy.stats import binomtest

        found = binomtest(self.true, self.cases).proportion_ci(confidence, method="exact")
        return float(found.low), float(found.high)


@dataclass(frozen=True)
class Compliance:
    """How probable it is that a case meets a requirement.  A case without result counts as not met."""

    output: Output
    below: Share
    """The value of the case, its best estimate, is not above the limit."""
    sure: Share
    """The verdict of the case is "met": so is the bound of that one run, with the requirement's own confidence."""
    pooled: Statement | None
    """Over all cases, as the interpretation of the requirement says (ECSS-E-ST-60-10C, 4.1.4.2); None where a case has
    no result, for a peak, and for a plan that is no sample.  See :func:`state_over_cases`."""
    answer: Answer | None
    """Whether it is met over all cases; None without a statement, and where the cases are no independent samples of the
    ensemble, because they share random numbers: then the statement is on these."""


def find_percentiles(outcome: Outcome) -> list[Percentiles]:
    """Of all outputs that some case has."""
    found = []
    for output in outcome.outputs:
        values = outcome.values(output)
        values = values[np.isfinite(values)]
        if len(values):
            found.append(
                Percentiles(
                    output,
                    len(values),
                    float(values.mean()),
                    float(values.std(ddof=1)) if len(values) > 1 else math.nan,
                    float(values.min()),
                    float(values.max()),
                    tuple(_state_percentile(outcome, values, probability) for probability in PROBABILITIES),
                )
            )
    return found


def _state_percentile(outcome: Outcome, values: Array, probability: float) -> Statement:
    stated = quantile(values, probability, CONFIDENCE)
    return stated if outcome.is_sample else replace(stated, lower=-math.inf, upper=math.inf, bound=math.inf)


def find_compliance(outcome: Outcome) -> list[Compliance]:
    """Of each requirement, signal and run."""
    found = []
    cases = len(outcome.table)
    for output in outcome.outputs:
        requirement = output.requirement
        if requirement is None or output.limit is None:
            continue
        values = outcome.values(output)
        column = output.name.removesuffix("/value") + ANSWER
        answers = [str(found) for found in outcome.table[column]] if column in outcome.table else []
        met = answers.count(Answer.MET.value)
        below = int((values <= output.limit).sum())  # NaN is not
        pooled = state_over_cases(outcome, output)
        shared = outcome.plan.shared_seeds and requirement.interpretation is not Interpretation.TEMPORAL
        answer = None if pooled is None or shared else _answer(pooled, output.limit, answers)
        found.append(Compliance(output, Share(below, cases), Share(met, cases), pooled, answer))
    return found


def state_over_cases(outcome: Outcome, output: Output) -> Statement | None:
    """The statement on a requirement over all cases, in the unit of its limit.

    ``ensemble``: quantile over the cases of the largest value of each.  ``mixed``: quantile of the values at all times
    of all cases, by their histograms.  ``temporal``: the worst case, whose bound has the confidence of that case alone;
    ``ensemble_share`` is the share of all possible cases that are no worse than the worst of these, with the same
    confidence.
    """
    requirement, values = output.requirement, outcome.values(output)
    if requirement is None or requirement.confidence is None or not np.isfinite(values).all() or not outcome.is_sample:
        return None
    if requirement.interpretation is Interpretation.MIXED:
        return outcome.pooled.get(output.name)
    if requirement.interpretation is Interpretation.ENSEMBLE:
        assert requirement.probability is not None  # of a quantile
        return quantile_of_peaks(values, requirement.probability, requirement.confidence)
    bounds = np.asarray(outcome.table[output.name.removesuffix("value") + "bound"], dtype=float)
    return Statement(
        value=float(values.max()), confidence=requirement.confidence, lower=-math.inf, upper=math.inf,
        bound=float(bounds.max()), independent=float(len(values)), method="worst case",
        probability=requirement.probability, ensemble_share=(1.0 - requirement.confidence) ** (1.0 / len(values)),
    )  # fmt: skip


def _answer(pooled: Statement, limit: float, answers: Sequence[str]) -> Answer:
    """Whether a requirement is met over all cases; a temporal one, if it is in each of them."""
    if pooled.ensemble_share is not None:
        if set(answers) == {Answer.MET.value}:
            return Answer.MET
        worse = (Answer.NOT_MET, Answer.OPEN)
        return next((one for one in worse if one.value in answers), Answer.NOT_SHOWN)
    return decide(pooled, limit)


def find_worst(outcome: Outcome, most: int = WORST) -> list[tuple[int, float, Output]]:
    """Cases that are worst: case, its value, and the output that it is worst in; the worst first.

    By the value over the limit, the largest of all requirements; without requirements by the first headline output
    over its median.
    """
    outputs = [output for output in outcome.headlines if output.limit is not None] or list(outcome.headlines[:1])
    if not outputs:
        return []
    scaled = np.column_stack([_scale(outcome, output) for output in outputs])
    scaled = np.where(np.isfinite(scaled), scaled, -math.inf)
    place = scaled.argmax(axis=1)
    score = scaled[np.arange(len(scaled)), place]
    order = [int(case) for case in np.argsort(-score, kind="stable") if math.isfinite(score[case])][:most]
    return [(case, float(outcome.values(outputs[place[case]])[case]), outputs[place[case]]) for case in order]


def find_failed(outcome: Outcome) -> list[tuple[int, str, str]]:
    """Case, status and error of all that are not done."""
    table = outcome.table[~outcome.done]
    return [(int(case), str(status), str(error)) for case, status, error in
            zip(table["case"], table["status"], table["error"], strict=True)]  # fmt: skip


def count_statuses(outcome: Outcome) -> dict[str, int]:
    """Cases by status."""
    return {str(status): int(count) for status, count in outcome.table["status"].value_counts().items()}


def _scale(outcome: Outcome, output: Output) -> Array:
    values = outcome.values(output)
    finite = values[np.isfinite(values)]
    unit = output.limit if output.limit is not None else float(np.median(finite)) if len(finite) else 1.0
    return np.asarray(values / (unit or 1.0))
