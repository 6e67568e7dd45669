"""The cases of a study, to be explored: any parameter against any metric, distributions, ranking, a table to sort."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .writer import Entry, encode, pack_fields

Array = NDArray[np.float64]

MOST_CASES = 10_000
"""That the page holds: some 3 MB with sixty metrics.  All are in the study's table."""


@dataclass(frozen=True)
class Mark:
    """A value of a metric that the distribution shows: a percentile."""

    label: str
    value: float


@dataclass(frozen=True, eq=False)
class CaseColumn:
    """A number of each case, ``values`` (cases,) in ``unit``; NaN where a case has none.

    ``levels``: texts that stand for the values 0, 1, ...  ``limit``: of the requirement.  ``marks``: percentiles.
    """

    title: str
    unit: str
    values: Array
    levels: Sequence[str] = ()
    limit: float | None = None
    marks: Sequence[Mark] = ()
    ranking: Sequence[float] = ()
    """Of a metric: how strongly it depends on each of the parameters, in their order; NaN: not known."""
    influences: Sequence[str] = ()
    """The same in words, each with how the metric depends on the parameter."""
    left: str = ""
    """What is left of the metric that no parameter explains by itself, in words."""

    def pack(self, chosen: NDArray[np.intp]) -> Entry:
        """As the page reads it."""
        return {
            **pack_fields(self),
            "values": encode(np.asarray(self.values, dtype=float)[chosen]),
            "marks": [pack_fields(mark) for mark in self.marks if np.isfinite(mark.value)],
            "ranking": [float(value) if np.isfinite(value) else None for value in self.ranking],
        }


@dataclass(frozen=True, eq=False)
class CaseTable:
    """All cases of a study, numbered from 0 on.

    ``measure`` names what ``ranking`` of the metrics is; ``command`` has the texts before and after the number of a
    case in the command that runs it again; ``failed`` maps cases without a result to the reason; ``first``: the cases
    that the page must hold, the most important first.

    Raises ``ValueError`` for columns of different lengths.
    """

    title: str
    caption: str
    parameters: Sequence[CaseColumn]
    metrics: Sequence[CaseColumn]
    measure: str
    command: tuple[str, str]
    failed: Mapping[int, str] = field(default_factory=dict)
    first: Sequence[int] = ()

    def __post_init__(self) -> None:
        for column in (*self.parameters, *self.metrics):
            if np.shape(column.values) != (len(self),):
                raise ValueError(f"column {column.title!r}: expected {len(self)} values")
        for column in self.metrics:
            if column.ranking and len(column.ranking) != len(self.parameters):
                raise ValueError(f"column {column.title!r}: expected {len(self.parameters)} ranks, one a parameter")

    def __len__(self) -> int:
        return len(self.parameters[0].values)

    def choose(self) -> NDArray[np.intp]:
        """The cases that the page holds, ascending: those of ``first``, and of the others every so-many-th."""
        if len(self) <= MOST_CASES:
            return np.arange(len(self))
        kept = np.unique(np.asarray([*self.failed, *self.first], dtype=np.intp)[: MOST_CASES // 2])
        others = np.setdiff1d(np.arange(len(self)), kept)
        step = -(-len(others) // (MOST_CASES - len(kept)))
        return np.union1d(kept, others[::step])

    def pack(self) -> Entry:
        """As the page reads it."""
        chosen = self.choose()
        held = set(chosen.tolist())
        return {
            "cases": encode(chosen.astype(float)),  # whole numbers up to 2^24 are exact
            "all": len(self),
            "parameters": [column.pack(chosen) for column in self.parameters],
            "metrics": [column.pack(chosen) for column in self.metrics],
            "measure": self.measure,
            "command": list(self.command),
            "failed": [[case, why] for case, why in self.failed.items() if case in held],
        }
