"""The cases of a study for its page, where the reader chooses what to see of them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..results.page.cases import CaseColumn, CaseTable, Mark
from .factors import Factor
from .outcome import Outcome, Output
from .sensitivity import Influence
from .statistics import Percentiles, find_failed, find_worst

WORST_SHOWN = 1000  # of a study that is too large for the page: these are there in any case
MOST_METRICS = 60
CAPTION = (
    "Each point is a case. Blue: up to the limit of the requirement, or without a limit; orange: above it. Dashed "
    "lines in the distribution are percentiles over all cases. The filter takes the number of a case, or a condition "
    "such as mass > 51 on a column of the table, in its unit."
)


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
