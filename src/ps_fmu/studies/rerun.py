"""A case of a study again: the same numbers to the last bit, with all signals and a report."""

from __future__ import annotations

import json
import math
import shlex
from dataclasses import replace
from pathlib import Path

from ..cosim import Column
from ..cosim.faults.numbers import change_numbers
from ..requirements.verdict import format_verdicts
from ..results.report import Report
from ..results.summary import plain, versions
from ..results.tables import Table
from ..runs.cases import Case, run_case
from ..runs.options import REPORT, RESULTS, SUMMARY
from ..runs.output import hold_folder
from ..runs.publish import show_verdict
from ..runs.setup import identify_fmus
from ..slavekit.pack.files import write_atomically
from .case_runner import describe_verdicts, make_records
from .fault_numbers import names_faults, split_values
from .indices import IndexRecord, SwitchRecord
from .loading import make_options
from .parts import list_parts, read_rows
from .rows import MEASURED, Row
from .study import StudyError
from .study_folder import explain_difference, read_identity
from .sweep import Prepared, SweepOptions, prepare
from .task import Task


class CaseRecord:
    """What a run of a case is observed by; its metrics go into the row."""

    def __init__(self, task: Task, columns: tuple[Column, ...]) -> None:
        self._records = make_records(task, columns)

    @property
    def observers(self) -> list[IndexRecord | SwitchRecord]:
        """For the master."""
        return self._records

    def metrics(self) -> Row:
        """By name."""
        return {key: value for record in self._records for key, value in record.metrics().items()}


def rerun(options: SweepOptions, case: int) -> str:
    """Run case ``case`` of a study; the text for the terminal.

    Where the output folder has this study, the results go into its folder ``case-N``, and the row is compared with the
    stored one; else into the output folder itself.

    Raises :class:`.study.StudyError` for a case that the plan has not, and for a folder with another study;
    :class:`..cosim.CosimError` if the case fails, as it did in the study.
    """
    prepared = prepare(options)
    if not 0 <= case < len(prepared.plan):
        raise StudyError(f"--case: the study has the cases 0 to {len(prepared.plan) - 1}, got {case}")
    stored = None
    folder = options.output.absolute()
    identity = read_identity(folder)
    if identity is not None:
        if difference := explain_difference(vars(identity), prepared.identity):
            raise StudyError(f"--output: {folder} has another study: {difference}")
        stored = find_row(folder, identity.plan_sha256, case)
        folder = folder / f"case-{case}"
    folder.mkdir(parents=True, exist_ok=True)
    with hold_folder(folder):
        row, text = _run(options, prepared, case, folder)
    return f"{text}\n{compare_rows(row, stored)}\nresults in {folder}"


def find_row(folder: Path, plan_hash: str, case: int) -> Row | None:
    """The row of a case in the parts of a study; None if it has none.  Raises ``OSError``."""
    for part in list_parts(folder, plan_hash):
        first, last = map(int, part.stem.split("-")[1:3])
        if first <= case <= last:
            rows: list[Row] = read_rows([part], histograms=True).to_pylist()
            return next((row for row in rows if row["case"] == case), None)
    return None


def compare_rows(row: Row, stored: Row | None) -> str:
    """Whether two rows of a case are the same to the last bit, in words."""
    if stored is None:
        return "the study has no row of this case to compare with"
    names = [name for name in {**row, **stored} if name not in (*MEASURED, "warnings")]
    others = [name for name in names if not _is_same(row.get(name), stored.get(name))]
    if not others:
        return "all numbers are those of the study, to the last bit"
    shown = "; ".join(f"{name}: {row.get(name)}, there {stored.get(name)}" for name in others[:5])
    return f"{len(others)} of {len(names)} numbers are not those of the study: {shown}"


def _run(options: SweepOptions, prepared: Prepared, case: int, folder: Path) -> tuple[Row, str]:
    study = prepared.plan.study
    targets = [name for name in prepared.plan.targets if not names_faults(name, prepared.system.descriptions)]
    varied = [prepared.system.structure.find_port(name).variable for name in targets]
    apart = tuple(f"{component}.{name}" for component in prepared.system.descriptions for name in varied)
    branch = study.branch
    run_options = replace(
        make_options(study, folder), progress=options.progress, apart=apart,
        command=shlex.join(["ps-fmu", "sweep", study.path.name, "--case", str(case)]),
        source=None if branch is None else branch.checkpoint, anew=() if branch is None else branch.anew,
    )  # fmt: skip
    (folder / RESULTS).unlink(missing_ok=True)
    system = prepared.system
    task = Task(study.step_s, study.duration_s, study.scheme, study.runs, study.observed, {})
    values = prepared.plan.values(case)
    starts, numbers = split_values(values, system.descriptions)
    if system.faults is not None:
        system = replace(system, faults=change_numbers(system.faults, numbers))
    row: Row = {"case": case, "status": "done", "error": None}
    tables = []
    for run, own in study.runs.items():
        _, record = run_case(
            system, run_options, Case(run, {**starts, **own}), lambda columns: CaseRecord(task, columns)
        )
        metrics = record.metrics()
        row |= {f"{run}.{key}": value for key, value in metrics.items()}
        rows = [(key, f"{value:.6g}") for key, value in metrics.items()]
        tables.append(Table(f"Run {run}", ("metric", "value"), rows))
    verdicts = system.judge.conclude()
    row |= describe_verdicts(system.judge)
    parameters = {"study": str(study.path), "case": case, "duration (s)": study.duration_s, "step (s)": study.step_s,
                  **values}  # fmt: skip
    fmus = identify_fmus(system)
    summary = {"study": study.name, "plan_sha256": prepared.identity.plan_sha256, "row": row, "parameters": parameters,
               "verdicts": [verdict.as_dict() for verdict in verdicts], "warnings": system.warnings.texts,
               "fmus": [vars(fmu) for fmu in fmus], "versions": versions()}  # fmt: skip
    write_atomically(folder / SUMMARY, json.dumps(plain(summary, "summary"), indent=2, allow_nan=False) + "\n")
    Report(
        title=f"{study.name}, case {case}",
        verdicts=list(map(show_verdict, verdicts)),
        text=[f"Case {case} of the study {study.name!r}. All signals are in {RESULTS}."],
        warnings=system.warnings.texts,
        tables=tables,
        parameters=parameters,
        fmus=fmus,
        versions=versions(),
    ).write(folder / REPORT)
    return row, "\n".join([*(f"{table.caption}\n{table.to_text()}" for table in tables),
                           *([format_verdicts(verdicts)] if verdicts else [])])  # fmt: skip


def _is_same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other):
        return True
    return one == other
