"""A whole study: plan, run what is missing, say what it says."""

from __future__ import annotations

import os
import shlex
import sys
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from ..results.style import prepare_drawing
from ..runs.options import claim_folder
from ..runs.output import lock_folder
from ..runs.setup import RunSystem
from .branching import check_sources, keep_seeds, read_sources
from .bundle import Bundle
from .control_variate import check_closed_form
from .loading import choose_fmus, choose_step, load_study_system
from .plan import Plan, make_plan
from .preparation import check_numbers, complete_observed, make_bundle
from .reading import read_study
from .stored import check_stored, list_work, list_worst, prepare_folder, remove_leftovers
from .study_folder import Identity

Report = Callable[[int, int], None]
"""Takes the number of cases of a batch, and how many of these are not done."""

QUIET_INTERVAL_S = 10.0  # between the lines of the progress bar in a log file


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
    progress: bool = True
    scheduler_timeout_s: float | None = None
    """That the scheduler may take to answer; None: some seconds."""

    @property
    def command(self) -> str:
        """The command that resumes the study."""
        words = ["ps-fmu", "sweep", str(self.study), "--output", str(self.output)]
        for name in ("scheduler", "workers", "fmus"):
            if (value := getattr(self, name)) is not None:
                words += [f"--{name}", str(value)]
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
    study = choose_step(replace(study, fmus=choose_fmus(study, options.fmus)))
    system = load_study_system(study)
    if study.control_variates:
        if study.faults is not None:
            raise study.error("control_variates", "the closed form has no faults")
        if study.branch is not None:
            raise study.error("control_variates", "the closed form has no state to begin from, as [from] gives one")
        try:
            check_closed_form(system, study.plan)
        except ValueError as error:
            raise study.error("control_variates", str(error)) from error
    sources = read_sources(study)
    system = keep_seeds(study, system, sources)
    plan = make_plan(complete_observed(study, system), system)
    check_numbers(plan, system)
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
    """Run the cases that no part has.

    Raises :class:`.rows.ClusterError`, :class:`.rows.StartError`, :class:`.rows.VersionError`, OSError and
    KeyboardInterrupt; the parts so far are kept.
    """
    from .cluster import CONNECT_S, Dispatcher, connect
    from .scheduler import Scheduler

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
        if dashboard := Scheduler(client).find_dashboard():
            print(f"dask's dashboard: {dashboard}", file=sys.stderr)

        prepare_drawing()  # while the workers start

        def run(cases: Sequence[int], stored: Collection[int], report: Report) -> None:
            Dispatcher(client, plan, name, prepared.bundle, folder, report).run(cases, stored)

        if cases:
            with _show_progress(options, "cases", len(plan), kept) as report:
                run(cases, stored, report)
            worst = list_worst(folder, plan, name, prepared.system)
        if worst:  # known only now: they run again, with their signals
            with _show_progress(options, "signals", len(worst), 0) as report:
                run(worst, worst, report)
    remove_leftovers(folder)


@contextmanager
def _show_progress(options: SweepOptions, name: str, cases: int, done: int) -> Iterator[Report]:
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
