"""Any system, of whatever maker, run once: what ``ps-fmu run FILE`` does."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..cosim import Column
from ..cosim.recording.delivery import read_rows
from ..results.datasets import open_results
from ..results.figures import Line, draw_quick_plot
from ..results.report import Picture
from .cases import Case, Outcome, run_case
from .options import PLOT, RESULTS, SOURCE
from .publish import Findings
from .run import Run
from .setup import select_stored
from .stored_rows import make_stored_names
from .system import RunSystem

CASE = "run"
"""Name of the run, and of its group in results.nc."""


class _Nothing:
    """What is computed during the run beside what all runs have."""

    observers = ()

    def __init__(self, columns: tuple[Column, ...]) -> None:
        """None of them is looked at."""


def list_cases() -> tuple[str, ...]:
    """Names of the runs."""
    return (CASE,)


def find(run: Run) -> Findings:
    """Run the system; what it is made of, and what was stored."""
    system = run.load()
    options, structure = run.options, system.structure
    outcome, _ = run_case(system, options, Case(CASE), _Nothing, needs=())
    stored = select_stored(system.columns, options.observe)
    title, ended = structure.labels.get("name") or options.system.stem, outcome.ended
    more: dict[str, object] = {
        "source": SOURCE,
        "system": str(structure.path),
        "components": {component.name: component.source.name for component in structure.components},
        "start_s": outcome.begin_s,
        "scheme": str(system.scheme),
        "inputs": sorted(system.inputs),
        "columns": stored,
        **({} if ended is None else {"ended_by": ended.component, "ended_at_s": ended.time}),
    }
    end_s = outcome.begin_s + outcome.simulated_s
    return Findings(
        title=title,
        text=[
            f"{len(structure.components)} FMUs from {outcome.begin_s:g} to {end_s:g} s, by "
            f"steps of {options.step_s:g} s; order of exchange: {system.scheme}. {len(stored)} columns are stored.",
        ],
        outcomes=[outcome],
        more=more,
        draw=partial(_draw, system=system, outcome=outcome, title=title, stored=stored),
    )


def _draw(
    folder: Path, *, system: RunSystem, outcome: Outcome, title: str, stored: Sequence[str]
) -> list[Picture]:
    """Draw what is stored; a warning says what is left out."""
    if not stored:
        return []
    places = make_stored_names([column.name for column in system.columns])
    with open_results(folder / RESULTS) as file:
        group = file.groups[CASE]
        rows = len(group.dimensions["time"])
        time = _read_column(group["time"], rows)
        lines = []
        for name in stored:
            variable = group[places[name]]
            lines.append(Line(name, variable.units, variable.dtype.kind != "f", partial(_read_column, variable, rows)))
        shaded = [(first + outcome.begin_s, last + outcome.begin_s) for first, last in outcome.find_spans()]
        left = draw_quick_plot(folder / PLOT, time, lines, title=title, shaded=shaded)
    if left:
        system.warnings.add(left)
    return [Picture(folder / PLOT, f"What is stored, over time.{f' {left[:1].upper()}{left[1:]}.' if left else ''}")]


def _read_column(variable: Any, rows: int) -> NDArray[np.float64]:
    return np.asarray(read_rows(variable, 0, rows), dtype=float)
