"""Checkpoints of a run: when they are taken, and how a run goes on from one.

A checkpoint belongs to a communication point.  It has the states of the FMUs there, the outputs, the rows of the
unfinished block, and the states of the observers, which have seen all blocks before.  So blocks are cut as without
checkpoints, and a run that goes on gives the same results, to the last bit.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from time import perf_counter

from ..clock import Schedule
from ..errors import SlaveError, UsageError
from ..fmu_instance import InstancePhase
from ..recording.delivery import Observer, name_observer
from ..wires import Assembly
from .files import CheckpointFolder, Journal
from .parts import (
    check_abilities,
    find_difference,
    identify,
    list_starts,
    load_fmu,
    load_rows,
    save_fmus,
    save_rows,
)
from .state import CheckpointError, DamagedCheckpointError, Journaled, State, Stateful
from .warm_start import WarmStart

log = logging.getLogger("ps_fmu.cosim")

_ADVICE = "Resume with the options of that run, or start the run again."

LEAST = 0.25
"""Part of the share that is for checkpoints in any case, where the rows in journals take more than the rest."""
LOOK_S = 0.1
"""A checkpoint that waits is looked at again after so long [s]: to stop at a communication point costs some 50 us."""


class Pace:
    """Tells when the last checkpoint has been paid for.

    All is measured as time that passes, not as processor time: where other programs have the processor both last
    longer, a disk that is slow counts, and a run that waits for FMUs in processes of their own has checkpoints all the
    same.  Rows that go into journals count as well.

    Parameters
    ----------
    share: of the time since a checkpoint that it may have taken, before the next; None: any
    clock: reads a time [s]

    Raises :class:`UsageError` for a share that is none.
    """

    def __init__(self, share: float | None, clock: Callable[[], float] = perf_counter) -> None:
        if share is not None and not share > 0.0:
            raise UsageError(f"checkpoint: expected a share of the time above 0, got {share!r}")
        self._share, self._clock = share, clock
        self._first_index, self._first_s = 0, clock()
        self._begun_s = -math.inf
        self._rows_s = self._cost_s = 0.0

    def start(self, index: int) -> None:
        """The run begins, at a communication point."""
        self._first_index, self._first_s = index, self._clock()

    def is_paid(self, rows_s: float) -> bool:
        """Whether a checkpoint may be taken now; the rows have taken ``rows_s`` since the start of the run [s]."""
        if self._share is None:
            return True
        earned = self._share * (self._clock() - self._begun_s)
        return self._cost_s <= max(earned - (rows_s - self._rows_s), LEAST * earned)

    @contextmanager
    def count(self, rows_s: float) -> Iterator[None]:
        """Count the time of the body, which takes a checkpoint."""
        self._begun_s, self._rows_s = self._clock(), rows_s
        try:
            yield
        finally:
            self._cost_s = self._clock() - self._begun_s

    def find_next_look(self, index: int) -> int:
        """The communication point at which to look again, as fast as the run has been."""
        passed = self._clock() - self._first_s
        steps = (index - self._first_index) * LOOK_S / passed if passed > 0.0 else 0.0
        return index + max(1, math.ceil(steps))


class Checkpoints:
    """Takes checkpoints of a run, and has it go on from the last one; ``Checkpoints(None)`` keeps nothing.

    The run is made by the same calls as for the first time, with ``resume``: a new master with the same arguments, its
    initialisation, observers that are made in the same way, ``run`` with the same duration and events.

    Parameters
    ----------
    folder: of the checkpoints, of this run alone; None: none are taken
    interval: simulated time between them [s], rounded up to whole steps
    share: of the time that passes they may take at most so much: one that falls due waits, for a multiple of the
        interval, until the last one has been paid for; the first one, and that at the end of a run, do not wait.  None:
        they may take any, and come at exact times
    resume: go on from the last checkpoint in the folder; from the start of the run if there is none
    source: begin in the state of another run
    notes: what else is to be kept; :attr:`kept_notes` has it when the run goes on

    Raises :class:`UsageError` for an interval that is no time, or a share that is none, :class:`CheckpointError` if the
    checkpoints to go on from are damaged.

    Example::

        with Master(system, 1e-4) as master:
            master.initialise()
            master.run(100.0, [recorder], checkpoints=Checkpoints(Path("kept"), 10.0, resume=True))
    """

    def __init__(
        self,
        folder: Path | None,
        interval: float = math.inf,
        *,
        share: float | None = None,
        resume: bool = False,
        source: WarmStart | None = None,
        notes: Callable[[], Mapping[str, State]] = dict,
    ) -> None:
        if not interval > 0.0:
            raise UsageError(f"checkpoint: expected a time above 0 s between checkpoints, got {interval!r}")
        self._folder = None if folder is None else CheckpointFolder(folder)
        self._interval, self._source, self._notes = interval, source, notes
        self._pace = Pace(share)
        self._found = self._folder.read() if resume and self._folder is not None else None
        self._schedule: Schedule = []
        self._past: list[State] | None = None  # what had happened where the run goes on
        self.last_time: float | None = None
        """Time of the last checkpoint that was written or gone on from [s]."""
        self._journals: list[Journal] = []
        self._observers: Sequence[Observer] = ()
        self._stateful: list[tuple[Stateful, Journal | None]] = []

    @property
    def kept_notes(self) -> Mapping[str, State]:
        """The notes of the checkpoint that the run goes on from; nothing without one."""
        notes = {} if self._found is None else self._found[1].get("notes")
        return notes if isinstance(notes, dict) else {}

    def begin(self, parts: Assembly, index: int, steps: int, observers: Sequence[Observer]) -> tuple[int, int]:
        """A run of ``steps`` from communication point ``index`` on begins; returns where it began, and where it is.

        Raises :class:`CheckpointError`: an FMU or an observer has no state that can be kept; the checkpoint is of
        another run, or damaged.  :class:`SlaveError`: an FMU refuses its state.
        """
        if self._folder is not None:
            check_abilities(parts)
            save_fmus(parts)  # before anything is computed: they may refuse it
            observers = [_unwrap(observer) for observer in observers]
            for observer in observers:
                if not isinstance(observer, Stateful):
                    raise CheckpointError(
                        f"{name_observer(observer)}: no checkpoints are possible: the observer has no save_state and "
                        "load_state"
                    )
        self._parts, self._observers = parts, observers
        self._first, self._steps, self._index = index, steps, index
        if self._found is not None:
            self._index = index = self._restore(*self._found)
        else:
            if self._source is not None:
                self._source.apply(parts)
        self._identity = {**identify(parts), "starts": list_starts(parts.wiring)} if self._folder is not None else {}
        self._every = max(1, math.ceil(self._interval / parts.clock.step - 1e-6)) if self._interval < math.inf else 0
        self._set_due(index)
        self._pace.start(index)
        return self._first, index

    def skip(self, schedule: Schedule) -> Schedule:
        """The events of the run that are to come.

        The run can no longer be refused for what it is given: one that begins anew takes the folder.  Raises
        :class:`CheckpointError` if what has happened is not what the checkpoint has in it.
        """
        self._schedule = list(schedule)
        past = self._past
        if past is None:
            if self._folder is not None:
                self._folder.clear()
            self._open_journals([None] * len(self._observers))
            return schedule
        left = schedule[len(past) :]
        if _list_events(schedule[: len(past)]) != past or (left and left[0][0] < self._index):
            assert self._found is not None
            raise CheckpointError(
                f"{self._found[0]}: belongs to another run: the events until t = "
                f"{self._parts.clock.time(self._index):.9g} s differ.\n  {_ADVICE}"
            )
        return left

    def limit(self, stop: int) -> int:
        """The last communication point to step to at once, ``stop`` at most."""
        return min(stop, self._due)

    def arrive(self, index: int, left: int, interrupted: bool) -> None:
        """The run is at a communication point; ``left`` events are to come.

        A checkpoint is taken if it is due and paid for, at the end of the run, and before it is interrupted.
        """
        if self._folder is None or not (index >= self._due or interrupted) or not self._is_between_steps():
            return
        rows_s = sum(journal.spent_s for journal in self._journals)
        if not (interrupted or index >= self._first + self._steps or self._pace.is_paid(rows_s)):
            self._set_due(self._pace.find_next_look(index) - 1)
            return
        with self._pace.count(rows_s):
            self._take(index, left)
        self._set_due(index)

    def end(self) -> None:
        """The run is over, whatever ended it."""
        for journal in self._journals:
            journal.close()

    def _set_due(self, index: int) -> None:
        end = self._first + self._steps
        self._due = end
        if self._every and index < end:
            self._due = min(end, self._first + ((index - self._first) // self._every + 1) * self._every)

    def _is_between_steps(self) -> bool:
        """Whether all FMUs are at the communication point: a step that was interrupted in parts is none."""
        loop = self._parts.loop
        running = all(one.phase is InstancePhase.RUNNING for one in self._parts.instances.values())
        return running and loop is not None and loop.is_between_steps

    def _take(self, index: int, left: int) -> None:
        parts, folder = self._parts, self._folder
        assert folder is not None
        past = _list_events(self._schedule[: len(self._schedule) - left])
        try:
            where = {"index": index, "began": self._first, "events": past}
            tree = {**where, "fmus": save_fmus(parts), **save_rows(parts)}
        except (SlaveError, UsageError) as error:
            if any(one.phase is not InstancePhase.RUNNING for one in parts.instances.values()):
                raise
            log.warning("no checkpoint at t = %.9g s: %s", parts.clock.time(index), error)
            return
        try:
            kept = [
                {
                    "name": name_observer(observer),
                    "state": dict(state.save_state()),  # first: it may add rows to the journal
                    "journal": None if journal is None else journal.sync(),
                }
                for observer, (state, journal) in zip(self._observers, self._stateful, strict=True)
            ]
            folder.write(
                index, {**tree, "run": self._identity, "observers": kept, "notes": dict(self._notes())}
            )
        except OSError as error:
            log.warning("%s: no checkpoint is written: %s", folder.path, error.strerror or error)
        else:
            self.last_time = parts.clock.time(index)

    def _restore(self, path: Path, kept: Mapping[str, State]) -> int:
        """Go on from a checkpoint; returns its communication point."""
        parts = self._parts
        try:
            if difference := find_difference(identify(parts), kept["run"]) or _find_start(
                list_starts(parts.wiring), kept["run"]["starts"]
            ):
                raise CheckpointError(
                    f"{path}: belongs to another run: {difference}.\n  {_ADVICE}"
                )
            index, began = int(kept["index"]), int(kept["began"])
            if index > began + self._steps:
                raise CheckpointError(
                    f"{path}: lies at t = {parts.clock.time(index):.9g} s, after the end of this run, "
                    f"{parts.clock.time(began + self._steps):.9g} s: expected a longer duration"
                )
            if index != int(kept["first"]) + len(kept["rows"]) - 1 or not 0 <= began <= index:
                raise ValueError("its rows end at another step")
            self._restore_observers(kept["observers"])
            load_rows(parts, kept)
            for name in parts.instances:  # behind the values that faults set in them anew
                load_fmu(parts, name, kept["fmus"][name])
            if not isinstance(kept["events"], list):
                raise ValueError("its events are not a list")
            self._past = kept["events"]
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, OverflowError) as error:
            raise DamagedCheckpointError(path, f"is damaged: {error!r}") from error
        assert self._folder is not None
        for newer in self._folder.list_files():
            if newer == path:
                break
            newer.unlink(missing_ok=True)  # damaged
        self._first, self.last_time = began, parts.clock.time(index)
        return index

    def _restore_observers(self, kept: Sequence[Mapping[str, State]]) -> None:
        names = [name_observer(observer) for observer in self._observers]
        if names != [one["name"] for one in kept]:
            there = ", ".join(str(one["name"]) for one in kept)
            raise CheckpointError(f"the observers are {there} in the checkpoint and {', '.join(names)} in this run")
        self._open_journals([one["journal"] for one in kept])
        for observer, one in zip(self._observers, kept, strict=True):
            assert isinstance(observer, Stateful)
            try:
                observer.load_state(one["state"])
            except (KeyError, ValueError, TypeError) as error:
                text = f"the state of the observer {one['name']} in the checkpoint cannot be used: {error!r}"
                raise CheckpointError(text) from error

    def _open_journals(self, kept: Sequence[Mapping[str, State] | None]) -> None:
        if self._folder is None:
            return
        for place, (observer, one) in enumerate(zip(self._observers, kept, strict=True)):
            assert isinstance(observer, Stateful)
            journal = None
            if isinstance(observer, Journaled):
                journal = self._folder.open_journal(place, observer.journal_width, one)
                self._journals.append(journal)
                observer.use_journal(journal)
            self._stateful.append((observer, journal))


def _unwrap(observer: Observer) -> Observer:
    """That which has the state, where one passes its rows on to another, ``observed``."""
    while (inner := getattr(observer, "observed", None)) is not None:
        observer = inner
    return observer


def _list_events(schedule: Schedule) -> list[State]:
    return [[index, str(port), value] for index, port, value in schedule]


def _find_start(own: Mapping[str, State], kept: Mapping[str, State]) -> str | None:
    """The first start value that is another one."""
    for name in sorted({*own, *kept}):
        if own.get(name) != kept.get(name):
            there, here = kept.get(name), own.get(name)
            return f"the start value of {name} is {there!r} in the checkpoint and {here!r} in this run"
    return None
