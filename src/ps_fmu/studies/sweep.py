"""A whole study: plan, run what is missing, for rows or for signals; or run one case again."""

from __future__ import annotations

import math
import os
import random
import shlex
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from ..cosim.faults.numbers import change_numbers
from ..requirements.requirement import read_requirements
from ..results.style import prepare_drawing
from ..results.tables import Table, format_tables
from ..runs.built_fmus import choose_fmus, provide_fmus
from ..runs.cases import Case, run_case
from ..runs.options import RESULTS, claim_folder
from ..runs.output import hold_folder, lock_folder
from ..runs.publish import Findings, publish
from ..runs.system import RunSystem
from .bundle import Bundle, Identity, explain_difference, read_identity
from .case_runner import describe_verdicts
from .factors import names_faults, split_values
from .observed import CaseRecord, check_size
from .outcome import collect, find_worst
from .plan import Plan, make_plan
from .preparation import (
    check_numbers,
    check_sources,
    complete_observed,
    keep_seeds,
    list_columns,
    load_study_system,
    make_bundle,
    make_options,
    read_sources,
    warn_of_delays,
)
from .rows import (
    DONE,
    MEASURED,
    SIGNALS,
    Row,
    RowStore,
    TrialError,
    check_free,
    list_reasons,
    list_stored,
    list_unstored,
)
from .study import StudyError, read_study

Count = Callable[[int, int], None]
"""Takes the number of cases of a batch, and how many of these are not done."""
TRIED = 4
"""Cases that are tried where case 0 fails: of studies that fail in half of their cases these stop 3 %."""
QUIET_INTERVAL_S = 10.0  # between the lines of the progress bar in a log file


def check_stored(plan: Plan, system: RunSystem) -> int:
    """Bytes of all signals that a study stores, estimated.  Raises :class:`.study.StudyError` if they are too many."""
    study, signals = plan.study, plan.study.signals
    if signals is None:
        return 0
    rows = round(study.duration_s / (signals.step or study.step_s)) + 1
    return check_size(signals, list_columns(plan.study, system), len(plan), len(study.runs), rows)


def prepare_folder(folder: Path, plan: Plan, system: RunSystem) -> None:
    """Remove leftovers, make the folder of the signals, if there are any.

    Raises ``OSError``, also if the disk has no room for all of them.
    """
    remove_leftovers(folder)
    if plan.study.signals is None:
        return
    (folder / SIGNALS).mkdir(exist_ok=True)
    stored = sum(path.stat().st_size for path in list_stored(folder).values())
    check_free(folder, check_stored(plan, system), stored)


def remove_leftovers(folder: Path) -> None:
    """Remove what processes were writing when they ended."""
    for path in (folder / SIGNALS).glob(".*.part"):
        path.unlink(missing_ok=True)


def list_work(folder: Path, plan: Plan, plan_hash: str) -> tuple[list[int], set[int]]:
    """The cases that have to run, in order, and those of them whose signals are stored.  Raises ``OSError``.

    A case that has a row, but lacks its signals, runs again: they were wanted later, or deleted.  Of one whose process
    was ended there are none.
    """
    statuses, signals = RowStore(folder, plan_hash).read_statuses(), plan.study.signals
    missing = {case for case in range(len(plan)) if case not in statuses}
    if signals is None:
        return sorted(missing), set()
    wanted = {case for case in range(len(plan)) if signals.wants(case)}
    again = set(list_unstored(folder, (case for case in wanted if statuses.get(case) == DONE)))
    return sorted(missing | again), wanted & (missing | again)


def list_worst(folder: Path, plan: Plan, plan_hash: str, system: RunSystem) -> list[int]:
    """The worst cases whose signals are wanted and not there; all cases have their rows.  Raises ``OSError``."""
    signals = plan.study.signals
    if signals is None or not signals.worst:
        return []
    requirements = () if plan.study.requirements is None else read_requirements(plan.study.requirements)
    outcome = collect(folder, plan, plan_hash, list_columns(plan.study, system), requirements)
    return list_unstored(folder, (case for case, _, _ in find_worst(outcome, signals.worst)))


@dataclass(frozen=True)
class SweepOptions:
    """The command line of ``ps-fmu sweep``."""

    study: Path
    output: Path
    scheduler: str | None = None
    """Address of a dask scheduler; None: a cluster on this machine."""
    workers: int | None = None
    """Of a cluster on this machine; None: one for each processor."""
    resume: bool = False
    fmus: Path | None = None
    """Folder of the FMUs; None: those of ps_fmu, built if they are not."""
    replace: Mapping[str, Path] = field(default_factory=dict)
    """FMUs in place of components, by their names; stronger than those of the study."""
    progress: bool = True
    scheduler_timeout_s: float | None = None
    """That the scheduler may take to answer; None: some seconds."""

    @property
    def replacements(self) -> list[str]:
        """The replacements as words of a command line."""
        return [word for name, path in self.replace.items() for word in ("--replace", f"{name}={path}")]

    @property
    def command(self) -> str:
        """The command that resumes the study."""
        words = ["ps-fmu", "sweep", str(self.study), "--output", str(self.output)]
        for name in ("scheduler", "workers", "fmus"):
            if (value := getattr(self, name)) is not None:
                words += [f"--{name}", str(value)]
        words += self.replacements
        if self.scheduler_timeout_s is not None:
            words += ["--scheduler-timeout", f"{self.scheduler_timeout_s:g}"]
        return shlex.join([*words, "--resume"])


@dataclass(frozen=True, eq=False)
class Prepared:
    """A study that can be run."""

    plan: Plan
    system: RunSystem
    bundle: Bundle
    identity: Identity


def prepare(options: SweepOptions) -> Prepared:
    """Read a study, its system and FMUs; plan all cases.

    Raises :class:`.study.StudyError`, :class:`..cosim.CosimError`, BuildError, OSError.
    """
    study = read_study(options.study)
    fmus = choose_fmus(study.system, options.fmus, outside=study.outside)
    if options.fmus is None:
        provide_fmus(fmus, study.system)
    study, system = load_study_system(replace(study, fmus=fmus, replace={**study.replace, **options.replace}))
    sources = read_sources(study)
    system = keep_seeds(study, system, sources)
    plan = make_plan(complete_observed(study, system), system)
    check_numbers(plan, system)
    warn_of_delays(plan, system)
    check_sources(plan, system, sources)
    check_stored(plan, system)
    bundle = make_bundle(plan.study, system, sources)
    return Prepared(plan, system, bundle, Identity.of(plan, system, bundle, sources))


@contextmanager
def hold(folder: Path) -> Iterator[Path]:
    """Make the output folder and lock it for the body; its absolute path.

    Raises :class:`..runs.options.OptionError` if it cannot be used, or another study is running in it.
    """
    folder = folder.absolute()
    claim_folder(folder)
    lock = lock_folder(folder)
    try:
        yield folder
    finally:
        if lock is not None:
            os.close(lock)


def compute(options: SweepOptions, prepared: Prepared, folder: Path) -> None:
    """Run the cases that have no row.

    Raises :class:`.rows.ClusterError`, :class:`.rows.StartError`, :class:`.rows.VersionError`,
    :class:`.rows.TrialError`, OSError and KeyboardInterrupt; the rows so far are kept.
    """
    from .cluster import CONNECT_S, Dispatcher, connect

    plan, name = prepared.plan, prepared.identity.plan_sha256
    prepare_folder(folder, plan, prepared.system)
    cases, stored = list_work(folder, plan, name)
    worst = [] if cases else list_worst(folder, plan, name, prepared.system)
    if not cases and not worst:
        return
    kept = len(plan) - len(cases)
    print(f"{plan.study.name}: {len(plan)} cases" + (f", {kept} of them done before" if kept else ""), file=sys.stderr)
    timeout = CONNECT_S if options.scheduler_timeout_s is None else options.scheduler_timeout_s
    with connect(options.scheduler, options.workers, timeout) as client:
        dispatcher = Dispatcher(client, plan, name, prepared.bundle, folder)
        if dashboard := dispatcher.find_dashboard():
            print(f"dask's dashboard: {dashboard}", file=sys.stderr)

        prepare_drawing()  # while the workers start
        if cases:
            with _show_progress(options, "cases", len(plan), kept) as report:
                tried = _try_some(cases, RowStore(folder, name), lambda some: dispatcher.run(some, stored, report))
                dispatcher.run([case for case in cases if case not in tried], stored, report)
            worst = list_worst(folder, plan, name, prepared.system)
        if worst:  # known only now: they run again, with their signals
            with _show_progress(options, "signals", len(worst), 0) as report:
                dispatcher.run(worst, worst, report)
    remove_leftovers(folder)


def _try_some(cases: Sequence[int], store: RowStore, run: Callable[[Sequence[int]], None]) -> set[int]:
    """Run the first case, and if that fails a few others, drawn from all; those that were run.

    So what is wrong with the study, rather than with a case, is known before all have failed of it.  A study that has
    rows is known to work, or is to go on all the same.  Raises :class:`.rows.TrialError` if all of them fail.
    """
    if next(store.read(), None) is not None:
        return set()
    tried: set[int] = set()
    for some in (cases[:1], sorted(random.Random(0).sample(cases[1:], min(TRIED, len(cases) - 1)))):
        run(some)
        tried.update(some)
        failed = [(row["case"], row["status"], row["error"]) for row in store.read() if row["status"] != DONE]
        if len(failed) < len(tried):
            return tried
    reasons = "\n".join(f"  {line}" for line in list_reasons(failed))
    raise TrialError(
        f"all {len(tried)} cases that were tried first have failed:\n{reasons}\nCorrect the study, and name another "
        f"--output.  --resume runs the other {len(cases) - len(tried)} cases all the same"
    )


@contextmanager
def _show_progress(options: SweepOptions, name: str, cases: int, done: int) -> Iterator[Count]:
    """A bar on the error stream with the time that is left; it counts what comes in from now on."""
    from tqdm import tqdm

    quiet = sys.stderr is None or not sys.stderr.isatty()
    with tqdm(
        total=cases, initial=done, desc=name, unit="case", disable=not options.progress or sys.stderr is None,
        file=sys.stderr, mininterval=QUIET_INTERVAL_S if quiet else 0.5,
    ) as bar:  # fmt: skip
        not_done = 0

        def report(cases: int, others: int) -> None:
            nonlocal not_done
            not_done += others
            if not_done:
                bar.set_postfix_str(f"{not_done} not done", refresh=False)
            bar.update(cases)

        yield report


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
        if difference := explain_difference(identity, prepared.identity):
            raise StudyError(f"--output: {folder} has another study: {difference}")
        stored = next(RowStore(folder, identity.plan_sha256).read(case), None)
        folder = folder / f"case-{case}"
    folder.mkdir(parents=True, exist_ok=True)
    with hold_folder(folder):
        row, text = _run(options, prepared, case, folder)
    return f"{text}\n{compare_rows(row, stored)}"


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
    values = prepared.plan.values(case)
    starts, numbers = split_values(values, system.descriptions)
    if system.faults is not None:
        system = replace(system, faults=change_numbers(system.faults, numbers))
    row: Row = {"case": case, "status": DONE, "error": None}
    tables, outcomes = [], []
    for run, own in study.runs.items():
        outcome, record = run_case(
            system, run_options, Case(run, {**starts, **own}),
            lambda columns: CaseRecord(study.observed, columns, study.step_s),
        )
        metrics = record.metrics()
        row |= {f"{run}.{key}": value for key, value in metrics.items()}
        rows = [(key, f"{value:.6g}") for key, value in metrics.items()]
        tables.append(Table(f"Run {run}", ("metric", "value"), rows))
        outcomes.append(outcome)
    row |= describe_verdicts(system.judge)
    findings = Findings(
        title=f"{study.name}, case {case}",
        text=[f"Case {case} of the study {study.name!r}. All signals are in {RESULTS}."],
        tables=tables,
        outcomes=outcomes,
        more={"study": study.name, "plan_sha256": prepared.identity.plan_sha256, "case": case, "values": values,
              "row": row},
    )  # fmt: skip
    said = [format_tables(tables)]
    publish(run_options, replace(system, structure=system.structure.with_parameters(starts)), findings, said.append)
    return row, "\n".join(said)


def _is_same(one: object, other: object) -> bool:
    if isinstance(one, float) and isinstance(other, float) and math.isnan(one) and math.isnan(other):
        return True
    return one == other
