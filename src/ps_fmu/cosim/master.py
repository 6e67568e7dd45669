"""The master algorithm: loads the FMUs of a system, initialises them together, steps them, frees them.

Fixed step; :mod:`.schemes` has the schemes.  Row 0 holds the outputs after initialisation, row n those at start + n h.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Iterable, Mapping, Sequence
from ctypes import c_int
from types import TracebackType
from typing import Self

from fmpy.model_description import ModelDescription

from .checkpoint.checkpoints import Checkpoints
from .clock import Event, Progress, Schedule, make_clock, make_schedule, time_progress
from .columns import RunColumns
from .description import check_value, find_variable, read_descriptions
from .errors import CosimError, SlaveEnded, SlaveError, UsageError
from .faults.active import make_faults
from .faults.reading import FaultFile
from .fmu_instance import InstancePhase
from .graph import KnownVariables, OpenInput, check_wiring
from .guard import NumberGuard, keep_rows, load_library, note_interrupts
from .initialisation import end_all, initialise, load, read_first_row
from .isolation.instance import Isolation, find_maker
from .recording.delivery import Delivery, Observer
from .rows import Column
from .schemes.making import plan_steps
from .schemes.resolving import resolve_scheme
from .schemes.scheme import Scheme, make_scheme
from .signals import Signal, bind_signals, get_first_values
from .stopwatch import Stopwatch
from .structure import Parameter, PortName, System, Value
from .wires import Assembly, find_fed

log = logging.getLogger("ps_fmu.cosim")

BLOCK_ROWS = 2000
"""Rows that observers get at once: a run of the default scenario costs 0.2 us a step less than by 1000, as by 4000."""


class Master(Assembly):
    """Simulate a system of FMUs.

    Parameters
    ----------
    system: the system, see :func:`read_system`
    step: communication step, s; by default the step of the system's experiment
    scheme: ``"jacobi"``, ``"gauss-seidel"``, ``"iterated"``, or a :class:`.schemes.scheme.Scheme`
    start_time: start time, s; by default the start time of the system's experiment
    block_rows: rows that an observer gets at a time
    descriptions: model descriptions by component, if they have been read before; each takes some 50 ms to read
    inputs: signals over time by ``component.variable`` or by the name of an input of the system, see
        :func:`.signals.read_signals`
    also: names of variables to record beside the outputs
    only: names of the columns to record; other outputs are read only if a connection needs them
    stopwatch: measures the time of each call of an FMU; a step then takes some 0.5 us longer
    isolation: FMUs that run in processes of their own; by default none
    faults: faults of signals and parameters, see :func:`.faults.reading.read_faults`

    Raises :class:`UsageError`, :class:`SystemFileError` or :class:`WiringError` before anything is loaded, and
    :class:`CosimError` if the compiled loop is missing.

    Example::

        with Master(read_system("system/SystemStructure.ssd", "build/fmus"), step=1e-4) as master:
            master.initialise()
            master.run(20.0, observers=[recorder])
    """

    def __init__(
        self,
        system: System,
        step: float | None = None,
        scheme: str | Scheme = "jacobi",
        *,
        start_time: float | None = None,
        block_rows: int = BLOCK_ROWS,
        descriptions: Mapping[str, ModelDescription] | None = None,
        inputs: Mapping[str, Signal] | None = None,
        also: Collection[PortName] = (),
        only: Collection[str] | None = None,
        stopwatch: Stopwatch | None = None,
        isolation: Isolation | None = None,
        faults: FaultFile | None = None,
    ) -> None:
        load_library()
        self.clock = make_clock(system, step, start_time)
        self.system = self._system = system
        self._make_instance = find_maker(isolation, system)
        self.descriptions = read_descriptions(system) if descriptions is None else descriptions
        self.scheme = resolve_scheme(make_scheme(scheme), system, self.descriptions, self.step)
        self._known = KnownVariables(self.descriptions)
        self.wiring = check_wiring(system, self.descriptions, self._known)
        self.signals = bind_signals(system, self.descriptions, inputs or {})
        self.faults = make_faults(faults, system, self.descriptions, self.clock, self.scheme)
        more = {*also, *self.faults.recorded}
        self.run_columns = RunColumns(system, self.descriptions, self.signals, self.scheme, more, only)
        self._block_rows = block_rows
        self.rows = self.run_columns.make_rows(block_rows)
        self.instances = {}
        self.stopwatch = stopwatch
        self.loop = None
        self._ended: SlaveEnded | None = None
        self._numbers = NumberGuard()
        self.values_set = {}
        self._closed = self._running = False
        self._index = 0

    # ---- what is known -----------------------------------------------------------------------------------

    @property
    def columns(self) -> tuple[Column, ...]:
        """All recorded outputs, inputs of the run and outputs of the system, in the order of the columns of a block."""
        return self.run_columns.every

    @property
    def open_inputs(self) -> tuple[OpenInput, ...]:
        """Inputs without a source; they keep their start value unless they are set."""
        return self.wiring.open_inputs

    @property
    def step(self) -> float:
        """Communication step [s]."""
        return self.clock.step

    @property
    def time(self) -> float:
        """Current communication point [s]."""
        return self.clock.time(self._index)

    @property
    def warnings(self) -> dict[str, int]:
        """Number of fmi2Warning that each component returned."""
        return {name: instance.warnings for name, instance in self.instances.items()}

    @property
    def phases(self) -> dict[str, InstancePhase]:
        """Phase of each loaded FMU between loading and freeing, by component."""
        return {name: instance.phase for name, instance in self.instances.items()}

    @property
    def ended(self) -> SlaveEnded | None:
        """The FMU that ended the simulation, with the ``time`` of its last row, s; None if no FMU did."""
        return self._ended

    def get(self, name: str) -> Value:
        """Return the value of any variable, ``component.variable``, at the current communication point."""
        port = self._find_port(name)
        if self.loop is None:
            raise UsageError(f"{name}: the system is not initialised, or closed")
        return self.instances[port.component].get([port.variable], self.time)[port.variable]

    def set(self, name: str, value: Value) -> None:
        """Set an input or a parameter, ``component.variable``, from the current communication point on.

        An input is disconnected and keeps the value; a column of an input of the run continues.  Raises
        :class:`UsageError`: no such variable, not of its type, a fixed parameter after the initialisation.
        """
        if self._closed:
            raise UsageError(f"{name}: the system is closed")
        self._apply(*self._check(name, value, self.loop is not None))

    # ---- life --------------------------------------------------------------------------------------------

    def record(self, only: Collection[str] | None) -> None:
        """Choose the columns to record before :meth:`initialise`, also for runs after a reset; see the constructor.

        Raises :class:`UsageError` if there is no such column, or if the system is initialised.
        """
        if self.loop is not None or self._closed:
            raise UsageError("record: the system is initialised, or closed: reset it first")
        self.run_columns.choose(only)
        self.rows = self.run_columns.make_rows(self._block_rows)

    def initialise(self) -> None:
        """Load all FMUs that are not loaded, set start values, exchange initial values, and read the outputs: row 0.

        Raises :class:`SlaveError` or :class:`SystemFileError`, after all FMUs are freed.
        """
        if self.loop is not None or self._closed:
            raise UsageError("the system is already initialised, or closed: reset it, or make a new Master")
        start = self.clock.start
        try:
            with note_interrupts() as interrupted:
                if not self.instances:
                    load(self.system, self.descriptions, self.instances, self._make_instance)
                given = {**get_first_values(self.signals, start, self.step), **self.values_set}
                iteration = self.scheme.iteration if self.scheme.is_iterated else None
                initialise(self.instances, self.system, self.wiring, given, start, iteration)
                read_first_row(self.instances, self.rows, start, self.signals, self.step)
                plan_steps(self)
            if interrupted:
                raise KeyboardInterrupt
        except BaseException:
            self._abort()
            raise

    def reset(self, start_values: Mapping[str, Value] | Mapping[str, Parameter] | None = None) -> None:
        """Return to the state before the initialisation without loading FMUs; call :meth:`initialise` next.

        Results have the same bits as those of a new Master with ``system.with_parameters(start_values)``.  An FMU that
        refuses fmi2Reset is freed and instantiated again.

        ``start_values``: values of parameters and inputs by ``component.variable``, which replace those of the system.
        Values of an earlier reset, or of :meth:`set`, are dropped.

        Raises :class:`UsageError` or :class:`WiringError`, before anything is done, if the master is closed or runs, if
        a variable does not exist, if a value is not of its type; :class:`SlaveError`, after the system is closed.
        """
        self._refuse_while_running("reset")
        if self._closed:
            raise UsageError("reset: the system is closed: make a new Master")
        system = self._system.with_parameters(start_values or {})
        self.wiring = check_wiring(system, self.descriptions, self._known)
        self._drop_loop()
        self.system, self._index, self._ended = system, 0, None
        self.values_set.clear()
        self.faults.reset()
        self.rows = self.run_columns.make_rows(self._block_rows)
        try:
            for instance in self.instances.values():
                instance.reset()
        except BaseException:
            self._abort()
            raise

    def run(
        self,
        duration: float,
        observers: Sequence[Observer] = (),
        events: Iterable[Event] = (),
        progress: Progress | None = None,
        *,
        checkpoints: Checkpoints | None = None,
    ) -> None:
        """Advance by ``duration``, s; the first run begins with row 0, a later run with the row after the last.

        If an FMU, an observer or Ctrl-C ends the run early, all observers first get all complete rows.  Then the FMUs
        are terminated and freed as far as the standard allows, and the error is raised.

        ``checkpoints`` store the run and continue it, see :class:`.Checkpoints`.

        An FMU may end the simulation (fmi2Discard with fmi2Terminated): this is no error, and :attr:`ended` is set.

        Raises :class:`UsageError` before the run for a duration or an event between two steps, :class:`SlaveError`,
        KeyboardInterrupt, and errors of observers.
        """
        self._refuse_while_running("run")
        if self.loop is None:
            raise UsageError("the system is closed" if self._closed else "call initialise() first")
        if self._ended is not None:
            raise UsageError(f"the simulation has ended: {self._ended}")
        keeper, steps = checkpoints or Checkpoints(None), self.clock.steps(duration)
        first, self._index = keeper.begin(self, self._index, steps, observers)
        end = first + steps
        self.clock.check_end(end)
        schedule = keeper.skip(make_schedule(events, self.clock, first, end, self._check))
        self._running = True
        try:
            count = lambda: 0 if self.loop is None else self.loop.count_rows()  # noqa: E731
            delivery = Delivery(self.rows, self.clock, self.columns, observers, count)
            with note_interrupts() as interrupted, keep_rows(delivery.store):
                self._advance(end, schedule, delivery, progress, interrupted, keeper)
        except SlaveEnded as ended:
            self._ended = ended
            log.warning("%s", ended)
        except BaseException as error:
            self._running = False
            failed = error.time if isinstance(error, SlaveError) else None  # a value may be refused some rows later
            stopped = self.time if failed is None else min(failed, self.time)
            error.add_note(f"The simulation of {self.system.path} stopped at t = {stopped:.9g} s.")
            self._abort()
            raise
        finally:
            self._running = False
            keeper.end()

    def close(self) -> None:
        """Terminate and free all FMUs; a second call does nothing.  Raises the first :class:`SlaveError`."""
        self._refuse_while_running("close")
        self._drop_loop()
        self._closed = True
        failures = end_all(self.instances.values(), self.time)
        if failures:
            raise failures[0]

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if error is None:
            self.close()
        else:
            self._abort()

    def _refuse_while_running(self, what: str) -> None:
        if self._running:
            raise UsageError(f"{what}: a run is under way; observers and progress may get and set values only")

    # ---- how ---------------------------------------------------------------------------------------------

    def _find_port(self, name: str) -> PortName:
        find_variable(self.descriptions[(port := self.system.find_port(name)).component], port.variable)
        return port

    def _check(self, name: str, value: Value, running: bool = True) -> tuple[PortName, Value]:
        port = self._find_port(name)
        return port, check_value(self.descriptions, port, value, running)

    def _apply(self, port: PortName, value: Value) -> None:
        new = port not in self.values_set
        self.values_set[port] = value
        if self.loop is not None:
            self.loop.forget()
            self.instances[port.component].set({port.variable: value}, self.time)
            cut = new and port in find_fed(self, ())
            if self.faults.note(port, value) or cut:
                plan_steps(self, None if cut else self.loop)

    def _drop_loop(self) -> None:
        loop, self.loop = self.loop, None
        if loop is not None:
            loop.forget()

    def _advance(
        self, end: int, schedule: Schedule, delivery: Delivery, progress: Progress | None, interrupted: c_int,
        keeper: Checkpoints,
    ) -> None:  # fmt: skip
        rows, clock = self.rows, self.clock
        note = time_progress(progress, self.time)
        try:
            while self._index < end or interrupted:
                while schedule and schedule[0][0] == self._index:
                    _, port, value = schedule.pop(0)
                    self._apply(port, value)
                assert self.loop is not None
                if self.faults.switch(self._index):
                    self.loop.forget()
                    plan_steps(self, self.loop)
                stop = self.faults.find_change(self._index, min(end, schedule[0][0]) if schedule else end)
                count = min(keeper.limit(stop) - self._index, rows.capacity - rows.filled)
                try:
                    with self._numbers.watch(self.time):
                        self.loop.advance(clock.times(self._index, count), interrupted)
                finally:
                    self._index = rows.first_index + rows.filled - 1
                if rows.filled == rows.capacity or self._index == end:
                    delivery.hand_over()
                else:
                    delivery.hand_over_early()
                note(self.time)
                stops = bool(interrupted)  # once: Ctrl-C may come at any moment
                keeper.arrive(self._index, len(schedule), stops)
                if stops:
                    raise KeyboardInterrupt
        except BaseException as error:
            delivery.conclude(error)

    def _abort(self) -> None:
        """Free everything after a failure, without hiding it behind another one."""
        try:
            self.close()
        except CosimError as second:
            log.warning("while closing: %s", second)
