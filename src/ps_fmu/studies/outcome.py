"""The rows of a study with its plan, as a table that pandas reads, and which columns say what."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column
from ..pointing.confidence import Statement
from ..pointing.interpretation import Interpretation
from ..requirements.pooled import Pool
from ..requirements.requirement import Requirement
from ..requirements.targets import find_targets
from .indices import find_signals, label_index
from .parts import list_parts, read_rows, read_texts, write_durably
from .plan import Plan
from .rows import DONE, HISTOGRAM, VERDICT
from .study_folder import PLAN

Array = NDArray[np.float64]

STUDY = "study.parquet"  # in the output folder


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
    def headlines(self) -> tuple[Output, ...]:
        """What figures show: the outputs of requirements; without requirements, the RMS of all that is observed."""
        required = tuple(output for output in self.outputs if output.requirement is not None)
        return required or tuple(output for output in self.outputs if output.name.endswith(".rms"))


def collect(folder: Path, plan: Plan, plan_hash: str, columns: Sequence[Column],
            requirements: Sequence[Requirement]) -> Outcome:  # fmt: skip
    """Join plan and parts, and write them as ``study.parquet``; all cases are there.  Raises ``OSError``."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    planned = pq.read_table(folder / PLAN)
    parts = list_parts(folder, plan_hash)
    rows = read_rows(parts)
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
    return Outcome(plan, joined.to_pandas(), outputs, pool_cases(parts, outputs, len(plan)))


def pool_cases(parts: Sequence[Path], outputs: Sequence[Output], cases: int) -> dict[str, Statement]:
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
        for text in read_texts(parts, output.name.removesuffix("/value") + HISTOGRAM):
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
