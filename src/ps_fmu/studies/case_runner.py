"""Run cases one after another in this process, in a system that stays: each becomes a row of numbers and verdicts."""

from __future__ import annotations

import time
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..cosim import Master, Observer, Recorder, RecorderError, SlaveError, Value
from ..cosim.checkpoint.checkpoints import Checkpoints
from ..cosim.checkpoint.state import CheckpointError
from ..cosim.checkpoint.warm_start import WarmStart
from ..cosim.columns import list_run_columns
from ..cosim.description import read_descriptions
from ..cosim.faults.binding import bind_faults
from ..cosim.faults.numbers import change_numbers
from ..cosim.faults.reading import read_faults
from ..cosim.signals import read_signals
from ..cosim.structure import decode_system
from ..pointing.interpretation import Interpretation
from ..requirements.decision import pack_distribution
from ..requirements.requirement import read_requirements
from ..runs.cases import Bounds
from ..runs.judge import RunJudge
from ..runs.keeping import SinceStart
from ..runs.logs import WarningLog
from ..runs.runner import Runner
from ..runs.stored_rows import make_stored_names, rename_columns
from ..terminal import reason
from .bundle import FAULTS, INPUTS, REQUIREMENTS, SYSTEM, TASK, Task, check_versions, worker_versions
from .factors import split_values
from .observed import CaseRecord, find_signals
from .rows import ANSWER, DONE, FAILED, HISTOGRAM, LONGEST_TEXT, VERDICT, Row

FATAL_STATUS = 4  # fmi2Fatal


class CaseRunner:
    """The cases of a study, from the folder of its files.

    Raises :class:`.rows.VersionError` where this process has other packages than the study was planned with, and
    :class:`..cosim.CosimError` for a system that cannot be read.
    """

    def __init__(self, folder: Path) -> None:
        self.task = task = Task.from_json((folder / TASK).read_bytes())
        check_versions(task.versions, worker_versions())
        files = {name: WarmStart(folder / name, task.anew) for name in dict.fromkeys(task.sources.values())}
        self._sources = {run: files[name] for run, name in task.sources.items()}
        """Read once: no case changes them."""
        self._began = next((source.time for source in files.values()), None)
        self._faults = read_faults(folder / FAULTS) if (folder / FAULTS).is_file() else None
        self._inputs = read_signals(folder / INPUTS) if (folder / INPUTS).is_file() else {}
        system = decode_system(folder / SYSTEM)
        self._descriptions = read_descriptions(system, lenient=True)
        self._runner = Runner(system, stays=True)
        self._numbers: dict[str, Value] = {}
        """Of faults, as the last run had them."""
        self.columns = list_run_columns(system, self._descriptions, self._inputs, task.scheme, task.step_s)
        self.requirements = read_requirements(folder / REQUIREMENTS) if (folder / REQUIREMENTS).is_file() else ()
        self._needed = {column.name for column in self.columns if column.type == "Boolean"}
        for observed in task.observed:
            self._needed.update(find_signals(observed, self.columns))
        self.must_end = False
        """An FMU in this process has returned fmi2Fatal: nothing more should run there (FMI 2.0.4, section 2.1.3)."""

    @contextmanager
    def prepare(self, values: Mapping[str, Value], only: Collection[str] | None = None) -> Iterator[Master]:
        """The system at its start with other values, ready to run in the body; its FMUs stay loaded.

        ``values``: start values by ``component.variable``, numbers of faults as ``faults.EVENT.key``.

        ``only``: names of the outputs that are needed; None: all.

        After an error the FMUs are loaded anew.  Raises :class:`..cosim.CosimError`.
        """
        starts, numbers = split_values(values, self._descriptions)
        if not self._runner.is_loaded:
            self._numbers = {}
        with self._runner.hold(
            starts, step=self.task.step_s, scheme=self.task.scheme, descriptions=self._descriptions,
            faults=self._faults, isolation=self.task.isolation, start_time=self._began, inputs=self._inputs,
        ) as master:  # fmt: skip
            if self._faults is not None and numbers != self._numbers:
                changed = change_numbers(self._faults, numbers)
                master.faults.change(bind_faults(changed, master.system, self._descriptions, master.clock))
                self._numbers = numbers
            master.record(only)
            master.initialise()
            yield master

    def close(self) -> None:
        """Free the FMUs; safe to call twice."""
        self._runner.close()

    def run(self, index: int, values: Mapping[str, Value], signals: Path | None = None) -> Row:
        """The row of a case; one that fails has its error in it.

        ``signals``: the netCDF file for what the task stores; of a case that fails it has the rows before.  Raises
        :class:`..cosim.RecorderError` and ``OSError`` if it cannot be written, which says nothing of the case.
        """
        row: Row = {"case": index, "status": DONE, "error": None}
        began = time.perf_counter()
        warnings = WarningLog(shown=False)
        with warnings.collect():
            try:
                with store(signals) as file:
                    row |= self._run_all(values, file)
            except Exception as error:  # whatever is wrong with this case: the study goes on
                if isinstance(error, RecorderError | OSError) and not isinstance(error, CheckpointError):
                    raise
                row |= {"status": FAILED, "error": f"{type(error).__name__}: {reason(error)}"[:LONGEST_TEXT]}
                self.must_end = self._is_fatal(error)
        row["warnings"] = "\n".join(warnings.texts)[:LONGEST_TEXT] or None
        row["wall_s"] = time.perf_counter() - began
        return row

    def _run_all(self, values: Mapping[str, Value], file: Path | None) -> Row:
        task, judge, row = self.task, RunJudge(self.requirements), Row()
        steps = round(task.duration_s / task.step_s)
        for name, own in task.runs.items():
            needed = {*self._needed, *judge.list_signals(name, self.columns), *(() if file is None else task.stored)}
            given, source = {**values, **own}, self._sources.get(name)
            with self.prepare(given, needed) as master:
                record = CaseRecord(task.observed, master.columns, task.step_s)
                watching: list[Observer] = [
                    *record.observers, *judge.observe(name, master.columns, task.step_s, steps)
                ]  # fmt: skip
                if self._began is not None:  # they are told times since the start of the run
                    watching = [SinceStart(observer, task.step_s) for observer in watching]
                begin = None if source is None else Checkpoints(None, source=source.giving(given.keys()))
                with self._make_recorder(name, master, file) as recorders:
                    master.run(task.duration_s, [Bounds(master.columns), *watching, *recorders], checkpoints=begin)
            row |= {f"{name}.{key}": value for key, value in record.metrics().items()}
        return row | describe_verdicts(judge)

    def _is_fatal(self, error: Exception) -> bool:
        if not isinstance(error, SlaveError) or error.status != FATAL_STATUS:
            return False
        isolation = self.task.isolation
        return isolation is None or not isolation.covers(error.component)

    @contextmanager
    def _make_recorder(self, run: str, master: Master, file: Path | None) -> Iterator[Sequence[Recorder]]:
        if file is None:
            yield ()
            return
        task, names = self.task, make_stored_names([column.name for column in master.columns])
        with Recorder(
            file, run, columns=rename_columns(master.columns, names), step=task.step_s,
            storage_step=task.stored_step_s, select=[names[name] for name in task.stored],
            attributes={"duration_s": task.duration_s, "step_s": task.step_s,
                        **({} if self._began is None else {"warm_start_s": self._began})}, append=file.exists(),
            rows=round(task.duration_s / task.step_s) + 1,
        ) as recorder:  # fmt: skip
            yield (recorder,)


@contextmanager
def store(path: Path | None) -> Iterator[Path | None]:
    """A new file for the body, which gets the name ``path`` at its end, also after an error of the case; None for None.

    Raises ``OSError``; nothing is left then.
    """
    if path is None:
        yield None
        return
    written = path.with_name(f".{path.stem}.part")
    written.unlink(missing_ok=True)
    try:
        yield written
    except (RecorderError, OSError):
        written.unlink(missing_ok=True)
        raise
    finally:
        if written.exists():
            written.replace(path)


def describe_verdicts(judge: RunJudge) -> Row:
    """The columns of all verdicts: ``verdict/REQUIREMENT/RUN/SIGNAL/...`` with answer, value and bound.

    Numbers are in the unit of the limit; the bound is infinite where there are too few samples for one.  A mixed
    requirement has its histogram, too: its quantile over all cases does not follow from those of each.
    """
    row: Row = {}
    for verdict in judge.conclude():
        place, stated = f"{VERDICT}{verdict.requirement.name}/{verdict.case}/{verdict.signal}", verdict.statement
        row[f"{place}{ANSWER}"] = verdict.answer.value
        row[f"{place}/value"] = None if stated is None else verdict.convert(stated.value)
        row[f"{place}/bound"] = None if stated is None else verdict.convert(stated.bound)
    for requirement, run, label, found in judge.list_distributions():
        if requirement.interpretation is Interpretation.MIXED:
            row[f"{VERDICT}{requirement.name}/{run}/{label}{HISTOGRAM}"] = pack_distribution(found)
    return row
