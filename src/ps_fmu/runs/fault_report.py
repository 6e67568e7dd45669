"""The faults of a run in summary.json, on the terminal, in the report and in figures."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from ..cosim.faults.binding import ActedFault
from ..results.tables import Table

Acted = Mapping[str, Sequence[ActedFault]]
"""The faults that acted in each run, by its name."""


def list_faults(path: Path, acted: Acted) -> dict[str, object]:
    """The entry of summary.json."""
    return {"file": path.name, "acted": {run: [fault.as_dict() for fault in found] for run, found in acted.items()}}


def tabulate_faults(acted: Acted) -> Table:
    """Each fault, and the runs that it acted in."""
    runs: dict[str, list[str]] = {}
    for run, found in acted.items():
        for fault in found:
            runs.setdefault(fault.text, []).append(run)
    rows = [(text, ", ".join(names)) for text, names in runs.items()] or [("none has acted", ", ".join(acted))]
    return Table("Faults", ("fault", "run"), rows)


def find_spans(faults: Iterable[ActedFault], end_s: float, *, begin_s: float = 0.0) -> list[tuple[float, float]]:
    """When any of the faults acted, to the end of the run at the latest [s]; spans that touch are one.

    Faults have times of the simulation; the spans, and ``end_s``, count from its time ``begin_s``.
    """
    spans: list[tuple[float, float]] = []
    for first, last in sorted(
        (f.from_s - begin_s, end_s if f.until_s is None else min(f.until_s - begin_s, end_s)) for f in faults
    ):
        if spans and first <= spans[-1][1]:
            spans[-1] = spans[-1][0], max(last, spans[-1][1])
        else:
            spans.append((first, last))
    return spans
