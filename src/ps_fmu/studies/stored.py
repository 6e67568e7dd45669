"""Which cases of a study still have to be run, for their rows or for their signals."""

from __future__ import annotations

from pathlib import Path

from ..requirements.reading import read_requirements
from ..runs.setup import RunSystem
from .loading import list_columns
from .outcome import collect
from .parts import FOLDER as PARTS
from .parts import read_statuses
from .plan import Plan
from .rows import DONE
from .signals import FOLDER as SIGNALS
from .signals import check_free, check_size, list_stored, list_unstored
from .statistics import find_worst


def check_stored(plan: Plan, system: RunSystem) -> int:
    """Bytes of all signals that a study stores, estimated.  Raises :class:`.study.StudyError` if they are too many."""
    study, signals = plan.study, plan.study.signals
    if signals is None:
        return 0
    rows = round(study.duration_s / (signals.step_s or study.step_s)) + 1
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
    for name in (PARTS, SIGNALS):
        for path in (folder / name).glob(".*.part"):
            path.unlink(missing_ok=True)


def list_work(folder: Path, plan: Plan, plan_hash: str) -> tuple[list[int], set[int]]:
    """The cases that have to run, in order, and those of them whose signals are stored.  Raises ``OSError``.

    A case that has a row, but lacks its signals, runs again: they were wanted later, or deleted.  Of one whose process
    was ended there are none.
    """
    statuses, signals = read_statuses(folder, plan_hash), plan.study.signals
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
