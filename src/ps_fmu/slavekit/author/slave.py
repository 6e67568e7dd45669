"""Base class of the slaves: pythonfmu's, on one buffer, one linear map per step, events apart from it.

The files it is made of, each one subject: ``model`` what a model states, ``values`` access to variables,
``stepper`` steps, and here the life cycle.  A simulation in order::

    instantiate --- set parameters and inputs --- setup_experiment --- enter_initialization_mode
        configure(), output_map()             whenever something was set and an output is read
    exit_initialization_mode                  configure() for good
    do_step(t, h) ...                         [event(t, h)] [step_map(h)] elements map elements
    terminate

Every call checks its arguments and the phase, and a refused call changes nothing.
"""

from __future__ import annotations

import os
import sys
import threading
from math import inf, isfinite
from typing import Any, ClassVar
from weakref import WeakSet
from xml.etree.ElementTree import Element

import numpy as np
from pythonfmu.enums import Fmi2Status

from ... import __version__
from .buffer import BufferLayout, copy_aligned
from .far import blame
from .guard import ModelError, Refused, Unreadable, protect, report
from .model import Model
from .state import Derived, LifePhase, SlaveState, from_bytes, to_bytes
from .stepper import Stepper
from .variables import Port, numbered, vector

__all__ = ["LifePhase", "ModelError", "Port", "Refused", "Slave", "numbered", "vector"]


_CALLED_BY_HOSTS = (
    *(f"{verb}_{kind}" for verb in ("get", "set") for kind in ("real", "integer", "boolean", "string")),
    "do_step", "setup_experiment", "enter_initialization_mode", "exit_initialization_mode", "terminate",
    "_get_fmu_state", "_set_fmu_state",
)  # fmt: skip


class Slave(Stepper):
    """FMI 2.0 co-simulation slave.  Subclasses fill in what :class:`.model.Model` lists."""

    instances: ClassVar[WeakSet[Slave]]
    """All that are alive, for :mod:`.guard`."""

    def __init_subclass__(cls, **kwargs: Any) -> None:
        super().__init_subclass__(**kwargs)
        if "__init__" in cls.__dict__:
            raise TypeError(f"{cls.__name__}: expected no __init__: make what the model needs in configure()")
        cls.any_step = cls.any_step or cls.continuous is not Model.continuous
        flags = {port.name for port in cls.ports if port.causality == "output" and port.type == "Boolean"}
        if cls.limit_flag and cls.limit_flag not in flags:
            raise TypeError(f"{cls.__name__}: limit_flag: expected a Boolean output, got {cls.limit_flag!r}")
        protect(cls, _CALLED_BY_HOSTS, ("_fmu_state_to_bytes", "_fmu_state_from_bytes"))
        cls.instances = WeakSet()
        cls.layout = BufferLayout(
            cls.__name__, __version__, cls.ports, cls.n_states, cls.n_auxiliary, cls.n_memory,
            cls.n_states if cls.provides_derivatives else 0,
        )  # fmt: skip

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.label = f"{type(self).__name__} {self.instance_name!r}"
        self.hosted = "logger" in kwargs  # only pythonfmu's native library passes one
        if self.hosted:
            _forget_host_thread()
        self._allocate()
        self._core.any_step, self._core.label = self.any_step, self.label.encode()
        self.instances.add(self)

    # --- Life cycle ---------------------------------------------------------------------

    def setup_experiment(
        self, start_time: float, stop_time: float | None = None, tolerance: float | None = None
    ) -> None:
        """Start and stop time, s.  The tolerance is not used: between events a step is exact."""
        self._require("setup_experiment", LifePhase.INSTANTIATED)
        stop = inf if stop_time is None else stop_time
        if not isfinite(start_time):
            raise Refused(f"start time {start_time!r} s: expected a finite number")
        if not stop > start_time:
            raise Refused(f"stop time {stop!r} s: expected a number above the start time {start_time!r} s")
        self._start = self._core.time = self._core.origin = float(start_time)
        self._core.stop = float(stop)
        self._ready = True
        self._stale = True  # outputs may have been read before; a model may use the start time

    def enter_initialization_mode(self) -> None:
        self._require("enter_initialization_mode", LifePhase.INSTANTIATED)
        if not self._ready:
            raise Refused("enter_initialization_mode: setup_experiment has to be called before")
        self._enter(LifePhase.INITIALISATION)

    def exit_initialization_mode(self) -> None:
        self._require("exit_initialization_mode", LifePhase.INITIALISATION)
        if self._stale:
            self._configure()
        self._prepare()
        self._enter(LifePhase.STEPPING)

    def terminate(self) -> None:
        self._require("terminate", LifePhase.STEPPING)
        self._enter(LifePhase.TERMINATED)

    def _require(self, call: str, phase: LifePhase) -> None:
        if self._phase != phase:
            now, wanted = self._phase.name.lower(), phase.name.lower()
            raise Refused(f"{call} is not possible in phase {now}, only in phase {wanted}")

    def _configure(self) -> None:
        """Build the model and the outputs from parameters and inputs.  All or nothing."""
        kept = self._buffer.data.copy()
        try:
            self._core.pending = False
            self.remap()
            self.configure()
            self._check_finite("configure()")
            outputs = self.output_map()
            if outputs is not None:
                matrix = copy_aligned(self._check_matrix("output_map", outputs, self.y.size))
                self.y[:] = matrix @ self._source[: matrix.shape[1]]
                self._check_finite("output_map()")
        except BaseException as error:
            self._buffer.data[:] = kept
            blame(error, self.layout, kept, self._core.step, self.default_step)
            raise
        self._stale = False

    def _check_finite(self, after: str) -> None:
        bad = np.flatnonzero(~np.isfinite(self._buffer.data))
        if bad.size:
            raise ModelError(f"{self.layout.describe(int(bad[0]))} is not finite after {after}")

    def _on_change(self, event: bool) -> None:
        if self._phase < LifePhase.STEPPING:
            self._stale = True
        elif event:
            self.request_event()

    # --- FMU state ----------------------------------------------------------------------

    def _get_fmu_state(self) -> SlaveState:
        buffer = self._buffer
        values, derived = (buffer.data.copy(), tuple(buffer.strings)), Derived(self._derived)
        return SlaveState(self.layout.identity, self._read_clock(), *values, derived)

    def _set_fmu_state(self, state: SlaveState | Unreadable) -> None:
        state = self._check_state(state)
        derived = self._find_derived(state)
        if derived is not None and self._has_steps_of(state.clock):
            self._buffer.data[:] = state.buffer
            self._buffer.strings[:] = state.strings
            self._go_back(state.clock)
            return
        before = self._get_fmu_state()
        try:
            self._put_state(state, derived)
        except BaseException as error:
            self._buffer.data[:] = before.buffer
            self._buffer.strings[:] = before.strings
            if before.clock.phase >= LifePhase.STEPPING:
                self._rebuild()
            self._recall(before.clock)
            blame(error, self.layout, state.buffer, state.clock.step, self.default_step)
            if isinstance(error, (ArithmeticError, ValueError)) and not isinstance(error, (ModelError, Refused)):
                raise Refused(f"the FMU state cannot be restored: {type(error).__name__}: {error}") from error
            raise

    def _check_state(self, state: SlaveState | Unreadable) -> SlaveState:
        if isinstance(state, Unreadable):
            raise Refused(state.why)
        if not isinstance(state, SlaveState) or state.identity != self.layout.identity:
            raise Refused("the FMU state belongs to another FMU, or to another version of this one")
        return state

    def _put_state(self, state: SlaveState, derived: Derived | None) -> None:
        self._buffer.data[:] = state.buffer
        self._buffer.strings[:] = state.strings
        self._recall(state.clock)
        if self._phase < LifePhase.STEPPING:
            self._stale = True  # configure() has to rebuild what is derived
        elif derived is not None:
            self._recall(state.clock)
        else:
            self._derive()
            self._recall(state.clock)
        if self._phase == LifePhase.STEPPING:
            self._prepare()

    @classmethod
    def _fmu_state_to_bytes(cls, state: SlaveState | Unreadable) -> bytes:
        """None at all of what is unreadable: by that the launcher knows it."""
        return b"" if isinstance(state, Unreadable) else to_bytes(state)

    @classmethod
    def _fmu_state_from_bytes(cls, state: bytes) -> SlaveState | Unreadable:
        try:
            return from_bytes(state, cls.layout)
        except Refused as error:
            return Unreadable(str(error))

    # --- Messages -----------------------------------------------------------------------

    def warning(self, text: str) -> None:
        """Send a warning to the host."""
        self.log(f"{self.label}: {text}", Fmi2Status.warning)

    def error(self, text: str) -> None:
        """Send an error to the host, and write it to stderr, since hosts may have logging off."""
        self.log(report(f"{self.label}: {text}"), Fmi2Status.error)

    def log(self, msg: str, status: Fmi2Status = Fmi2Status.ok, category: str | None = None, debug: Any = None) -> None:
        """As pythonfmu's, but safe: hosts take the text for a printf format.

        The library never frees a text that it has logged, so equal texts are made one object.
        """
        if category is None:
            category = "logAll" if status == Fmi2Status.ok else f"logStatus{status.name.capitalize()}"
        super().log(sys.intern(msg.replace("%", "%%")), status, sys.intern(category), debug)

    # --- Description --------------------------------------------------------------------

    def to_xml(self, model_options: dict[str, str] | None = None) -> Element:
        """The complete ``fmiModelDescription``, see :mod:`.description`; the options are its own."""
        from .description import model_description

        return model_description(self, super().to_xml)


def _forget_host_thread() -> None:
    """Let Python end although a thread of the host, not the main one, was the first to import ``threading``.

    Python 3.11 and 3.12 take such a thread for the main one and wait at exit until it has ended, which libcosim's
    do after that only.  Newer ones have no such list.
    """
    main = threading.main_thread()
    waited_for = getattr(threading, "_shutdown_locks", None)
    if waited_for is not None and main.native_id != os.getpid():
        waited_for.discard(getattr(main, "_tstate_lock", None))
