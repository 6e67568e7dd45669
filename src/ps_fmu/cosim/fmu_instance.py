"""One loaded FMU: typed access in batches, and a status that is never ignored.

FMPy loads the library and declares its functions; this class calls them, knows in which phase the instance
is, and so what may still be called after a failure (FMI 2.0.4, section 4.2.4, state machine for
co-simulation).
"""

from __future__ import annotations

import ctypes
import logging
from collections.abc import Iterable, Mapping, Sequence
from ctypes import byref, c_char, c_char_p, c_double, c_int, c_size_t, c_uint, c_void_p
from enum import Enum, auto
from typing import Any, NoReturn

from fmpy.model_description import ModelDescription

from . import guard
from .description import convert_value, index_variables, read_tolerance
from .errors import DiscardedStep, SlaveEnded, SlaveError, SystemFileError, UsageError, name_status
from .library import find_missing_in, is_pythonfmu, load_library, release_once
from .messages import MessageLog, forget, listen
from .structure import Component, Value
from .unpacked import discard_unpacked, ease_imports, provide_unpacked, release_unpacked
from .values import parse_real

log = logging.getLogger("ps_fmu.cosim")

OK, WARNING, DISCARD, ERROR, FATAL, PENDING = range(6)
LAST_SUCCESSFUL_TIME, TERMINATED = 2, 3  # fmi2StatusKind

FAMILY = {name: name for name in ("Real", "Integer", "Boolean", "String")} | {"Enumeration": "Integer"}
"""FMI type -> the ending of its access functions."""
C_TYPES: dict[str, Any] = {"Real": c_double, "Integer": c_int, "Boolean": c_int, "String": c_char_p}


class InstancePhase(Enum):
    """Where an instance is in its life."""

    INSTANTIATED = auto()
    INITIALISING = auto()
    RUNNING = auto()
    STEP_FAILED = auto()
    ERROR = auto()
    FATAL = auto()
    TERMINATED = auto()
    FREED = auto()


_ADVICE = {
    DISCARD: "Choose a smaller step, or correct the values that the FMU refuses.",
    ERROR: "The instance cannot continue: correct the cause and start again.",
    FATAL: "The FMU is not called again, not even to free it: correct the cause and start again, "
    "in a new process if need be.",
    PENDING: "The FMU steps asynchronously, which this master does not support: use a version of the FMU that steps at "
    "once, if its maker has one (canRunAsynchronuously).",
}


class FmuInstance:
    """An instance of an FMU, from loading its library to freeing it.

    Raises :class:`SystemFileError` if the FMU cannot be unpacked or loaded, :class:`SlaveError` from every
    call that returns more than fmi2Warning; warnings are shown once and counted in ``warnings``.
    """

    shares_process = True
    """Its library is loaded into this process."""

    def __init__(self, component: Component, description: ModelDescription) -> None:
        self.name = component.name
        self.source = component.source
        self.variables = index_variables(description)
        self.derives: bool = description.coSimulation.providesDirectionalDerivative
        self._tolerance = read_tolerance(description)
        self.messages = MessageLog(self.name)
        self.warnings = 0
        # One that may be instantiated only once has its data in the library, and gets one of its own.
        alone = description.coSimulation.canBeInstantiatedOnlyOncePerProcess
        self._folder = provide_unpacked(component.source, shared=not alone)
        try:
            self._fmu = self._load(component, description)
            self._callbacks = listen(self.messages)
            self._instantiate()
        except BaseException:
            release_unpacked(self._folder)
            raise

    def _load(self, component: Component, description: ModelDescription) -> Any:
        fmu = load_library(component, description, self._folder)
        if is_pythonfmu(fmu.dll) and (problem := find_missing_in(self._folder)):
            raise SystemFileError(component.source, problem)
        return fmu

    def _instantiate(self) -> None:
        """fmi2Instantiate of the library."""
        try:
            with ease_imports(), guard.NamedCall(f"{self.name}: fmi2Instantiate"):
                self._fmu.instantiate(callbacks=self._callbacks, loggingOn=True)
        except Exception as error:
            forget(self._callbacks)
            messages = self.messages.take()
            text = f"{self.name}: fmi2Instantiate failed: {error}{quote(messages)}"
            raise SlaveError(text, component=self.name, function="fmi2Instantiate", messages=messages) from error
        self.address: int = self._fmu.component
        self.phase = InstancePhase.INSTANTIATED

    # ---- the life of an instance -------------------------------------------------------------------------

    def set_up(self, start_time: float) -> None:
        """fmi2SetupExperiment, without a stop time: the end of a run is not known when it begins.

        The tolerance is that of the FMU's default experiment, if it states one: its solver is set for that.
        """
        given = self._tolerance is not None
        self._call("fmi2SetupExperiment", int(given), self._tolerance or 0.0, start_time, 0, 0.0, time=start_time)

    def enter_initialisation(self, time: float) -> None:
        """fmi2EnterInitializationMode."""
        self._call("fmi2EnterInitializationMode", time=time)
        self.phase = InstancePhase.INITIALISING

    def exit_initialisation(self, time: float) -> None:
        """fmi2ExitInitializationMode."""
        self._call("fmi2ExitInitializationMode", time=time)
        self.phase = InstancePhase.RUNNING

    def terminate(self, time: float) -> None:
        """fmi2Terminate, where the standard allows it; otherwise nothing."""
        if self.phase in (InstancePhase.RUNNING, InstancePhase.STEP_FAILED):
            self.phase = InstancePhase.TERMINATED
            self._call("fmi2Terminate", time=time)

    def free(self) -> None:
        """fmi2FreeInstance; the library stays loaded.  Nothing after fmi2Fatal."""
        self.messages.show_held()
        if self.phase not in (InstancePhase.FATAL, InstancePhase.FREED):
            self.phase = InstancePhase.FREED
            release_once(self._fmu.dll)
            with guard.NamedCall(f"{self.name}: fmi2FreeInstance"):
                self._fmu.freeInstance()
            forget(self._callbacks)
            release_unpacked(self._folder)

    def reset(self) -> None:
        """fmi2Reset: the instance is as after fmi2Instantiate.

        One that refuses it is freed, and another one of the same library takes its place.
        """
        self.messages.show_held()
        try:
            self._call("fmi2Reset")
        except SlaveError:
            if self.phase is InstancePhase.FATAL:
                raise
            self._fmu.fmi2FreeInstance(self._fmu.component)
            self.phase = InstancePhase.FREED
            self._instantiate()
        self.phase = InstancePhase.INSTANTIATED
        self.warnings = 0

    # ---- states ------------------------------------------------------------------------------------------

    def get_state(self) -> int:
        """fmi2GetFMUstate: a state of the FMU, by its address; give it back by :meth:`free_state`."""
        state = c_void_p()
        self._call("fmi2GetFMUstate", byref(state))
        return state.value or 0

    def try_state(self) -> int | None:
        """As :meth:`get_state`; None from an FMU that has none, which may go on.  Raises :class:`SlaveError`: fatal."""
        before = self.phase
        try:
            return self.get_state()
        except SlaveError:
            if self.phase is InstancePhase.FATAL:
                raise
            self.phase = before
            return None

    def set_state(self, state: int) -> None:
        """fmi2SetFMUstate: go on from a state of :meth:`get_state`, also after a step that was discarded."""
        self._call("fmi2SetFMUstate", c_void_p(state))
        self.phase = InstancePhase.RUNNING

    def free_state(self, state: int) -> None:
        """fmi2FreeFMUstate."""
        if self.phase not in (InstancePhase.FATAL, InstancePhase.FREED):
            self._call("fmi2FreeFMUstate", byref(c_void_p(state)))

    def write_state(self) -> bytes:
        """The state now as bytes, by fmi2SerializeFMUstate: for a file, and :meth:`read_state`."""
        state = self.get_state()
        try:
            size = c_size_t()
            self._call("fmi2SerializedFMUstateSize", c_void_p(state), byref(size))
            content = (c_char * size.value)()
            self._call("fmi2SerializeFMUstate", c_void_p(state), content, size)
        finally:
            self.free_state(state)
        return content.raw

    def read_state(self, content: bytes) -> None:
        """Go on from the state of :meth:`write_state`, by fmi2DeSerializeFMUstate."""
        state = c_void_p()
        array = (c_char * len(content)).from_buffer_copy(content)
        self._call("fmi2DeSerializeFMUstate", array, c_size_t(len(content)), byref(state))
        try:
            self.set_state(state.value or 0)
        finally:
            self.free_state(state.value or 0)

    # ---- variables ---------------------------------------------------------------------------------------

    def set(self, values: Mapping[str, Value], time: float) -> None:
        """Set variables by name, one call per type.  Raises :class:`UsageError` for a value that one cannot have."""
        for family, names in self._families(values).items():
            typed = [self._convert(name, values[name], time) for name in names]
            raw = [value.encode() if isinstance(value, str) else value for value in typed]
            array = (C_TYPES[family] * len(names))(*raw)
            self._call(f"fmi2Set{family}", *self._references(names), array, time=time, variables=names)

    def _convert(self, name: str, value: Value, time: float) -> Value:
        try:
            return convert_value(self.variables[name], value)
        except UsageError as error:
            raise UsageError(f"{self.name}.{name} at t = {time:.9g} s: {error}") from error

    def get(self, names: Iterable[str], time: float) -> dict[str, Value]:
        """Values of variables by name, one call per type."""
        result: dict[str, Value] = {}
        for family, group in self._families(names).items():
            array = (C_TYPES[family] * len(group))()
            self._call(f"fmi2Get{family}", *self._references(group), array, time=time, variables=group)
            for name, raw in zip(group, array, strict=True):
                value = (raw or b"").decode("utf-8", errors="replace") if family == "String" else raw
                result[name] = bool(value) if self.variables[name].type == "Boolean" else value
        return result

    def get_directional_derivative(self, names: Sequence[str], seeds: Mapping[str, float], time: float) -> list[float]:
        """fmi2GetDirectionalDerivative of outputs by name, along the changes ``seeds`` of inputs by name."""
        changes = (c_double * len(seeds))(*seeds.values())
        result = (c_double * len(names))()
        references = *self._references(names), *self._references([*seeds])
        self._call("fmi2GetDirectionalDerivative", *references, changes, result, time=time, variables=names)
        return list(result)

    def get_nominal(self, name: str) -> float:
        """Nominal magnitude of a Real; 1 where none is stated."""
        stated = parse_real(str(self.variables[name].nominal))
        return abs(stated) if stated else 1.0

    def find_address(self, function: str) -> int:
        """Address of a function of the library, which the loop in C calls."""
        address = ctypes.cast(getattr(self._fmu.dll, function), c_void_p).value
        assert address is not None
        return address

    # ---- status ------------------------------------------------------------------------------------------

    @property
    def has_failed(self) -> bool:
        """Whether a call has failed so that no step may follow."""
        return self.phase in (InstancePhase.STEP_FAILED, InstancePhase.ERROR, InstancePhase.FATAL)

    def check(self, function: str, status: int, time: float | None, variables: Sequence[str] = ()) -> None:
        """Take a status seriously: pass fmi2OK, count and show fmi2Warning, raise on everything else."""
        if status == OK:
            return
        where = f"{function}{at_time(time)}"
        if status == WARNING:
            self.warnings += 1
            self.messages.show(f"{function} returned fmi2Warning", time)
            return
        advice = _ADVICE.get(status, "Only synchronous instances that answer with an fmi2Status can be run.")
        details = f" (variables: {', '.join(variables)})" if variables else ""
        if status == DISCARD and function == "fmi2DoStep":
            self.phase = InstancePhase.STEP_FAILED
            self._raise_discarded(time)
        if status != DISCARD:
            self.phase = InstancePhase.FATAL if status == FATAL else InstancePhase.ERROR
            if status == FATAL:  # all instances of the library are corrupt (FMI 2.0.4, section 2.1.3): no more of them
                discard_unpacked(self._folder)
        messages = self.messages.take()
        text = f"{self.name}: {where} returned {name_status(status)}{details}{quote(messages)}\n  {advice}"
        raise SlaveError(
            text, component=self.name, function=function, status=status, time=time, variables=variables,
            messages=messages,
        )  # fmt: skip

    def _has_ended(self) -> bool:
        """What fmi2GetBooleanStatus says of fmi2Terminated."""
        ended = c_int()
        return self._fmu.dll.fmi2GetBooleanStatus(self.address, TERMINATED, byref(ended)) <= WARNING and bool(ended)

    def _raise_discarded(self, time: float | None) -> NoReturn:
        """Say whether the FMU has ended the simulation, or has only not made this step."""
        reached, over = c_double(), self._has_ended()
        known = self._fmu.dll.fmi2GetRealStatus(self.address, LAST_SUCCESSFUL_TIME, byref(reached)) <= WARNING
        details = f", last successful time {reached.value:.9g} s" if known else ""
        messages = self.messages.take()
        where = f"{self.name}: fmi2DoStep{at_time(time)} returned fmi2Discard"
        if over:
            text = f"{where} and fmi2Terminated{details}: the FMU has ended the simulation"
        else:
            text = f"{where}{details}{quote(messages)}\n  {_ADVICE[DISCARD]}"
        error = (SlaveEnded if over else DiscardedStep)(
            text, component=self.name, function="fmi2DoStep", status=DISCARD, time=time, messages=messages
        )
        error.reached = reached.value if known else None
        raise error

    def _call(self, function: str, *arguments: Any, time: float | None = None, variables: Sequence[str] = ()) -> None:
        if self.phase in (InstancePhase.FATAL, InstancePhase.FREED):
            raise UsageError(f"{self.name}: {function} cannot be called, the instance is {self.phase.name.lower()}")
        with guard.NamedCall(f"{self.name}: {function}{at_time(time)}"):
            status = getattr(self._fmu.dll, function)(self.address, *arguments)
        self.check(function, status, time, variables)

    def _families(self, names: Iterable[str]) -> dict[str, list[str]]:
        families: dict[str, list[str]] = {}
        for name in names:
            families.setdefault(FAMILY[self.variables[name].type], []).append(name)
        return families

    def _references(self, names: Sequence[str]) -> tuple[Any, int]:
        array = (c_uint * len(names))(*(self.variables[name].valueReference for name in names))
        return array, len(names)


def at_time(time: float | None) -> str:
    """The time [s] of a call as part of an error text."""
    return "" if time is None else f" at t = {time:.9g} s"


def quote(messages: Sequence[str]) -> str:
    """The last messages of an FMU as part of an error text."""
    if not messages:
        return "\n  The FMU logged nothing."
    return "\n  Messages of the FMU:\n" + "\n".join("    " + line.replace("\n", "\n    ") for line in messages)


def keep_states(instances: Iterable[FmuInstance]) -> dict[FmuInstance, int]:
    """The present states; give them back by :func:`release_states`.  Raises :class:`SlaveError`, none is kept then."""
    states: dict[FmuInstance, int] = {}
    try:
        for instance in instances:
            states[instance] = instance.get_state()
    except BaseException:
        release_states(states)
        raise
    return states


def release_states(states: Mapping[FmuInstance, int]) -> None:
    """Give states back; an FMU that refuses is named in a warning, for what went wrong before says more."""
    for instance, state in states.items():
        try:
            instance.free_state(state)
        except SlaveError as error:
            log.warning("%s", error)
