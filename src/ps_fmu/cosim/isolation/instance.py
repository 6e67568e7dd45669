"""An FMU in a process of its own: the master calls stand-ins for its functions, which pass the calls on.

So the plan of the steps, its loop in C and the life of an instance are the same as for an FMU in this process.
"""

from __future__ import annotations

import argparse
import ctypes
import math
import os
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from typing import Any, NoReturn

from fmpy.fmi2 import fmi2CallbackFunctions
from fmpy.model_description import ModelDescription

from ..errors import SlaveError, UsageError
from ..fmu_instance import FAMILY, FATAL, OK, WARNING, FmuInstance, InstancePhase, at_time, quote
from ..isolation import guest_process
from ..library import find_binary
from ..messages import forget
from ..structure import Component, System
from ..unpacked import release_unpacked
from .guest_process import GuestProcess, Outcome, find_library, load_library

STEP_TIMEOUT_S = 60.0
CALL_TIMEOUT_S = 60.0


@dataclass(frozen=True)
class Isolation:
    """Which FMUs get processes of their own, and how long a call of a step may take there.

    Parameters
    ----------
    names: of components; None: all
    step_timeout_s: after this time [s] the process is ended, and the run with it
    call_timeout_s: the same for a call that is of no step, as to instantiate, initialise, terminate and free, in which
        FMUs load data and start tools [s]; None: :data:`CALL_TIMEOUT_S`, or that of a step if it is longer
    """

    names: frozenset[str] | None = None
    step_timeout_s: float = STEP_TIMEOUT_S
    call_timeout_s: float | None = None

    @property
    def timeouts_s(self) -> tuple[float, float]:
        """How long a call of a step may take, and any other [s]."""
        longest = self.call_timeout_s
        return self.step_timeout_s, max(self.step_timeout_s, CALL_TIMEOUT_S) if longest is None else longest

    def check(self, system: System) -> None:
        """Raises :class:`UsageError` for a name that is none of the system's, and where FMUs cannot be isolated."""
        find_library()
        for name in sorted(self.names or ()):
            system.component(name)

    def covers(self, name: str) -> bool:
        """Whether the FMU of a component has a process of its own."""
        return self.names is None or name in self.names

    def make_instance(self, component: Component, description: ModelDescription) -> FmuInstance:
        """Load an FMU where it belongs.  Raises as :class:`FmuInstance`."""
        if self.covers(component.name):
            return IsolatedInstance(component, description, self.timeouts_s)
        return FmuInstance(component, description)


class _RemoteLibrary:
    """What :class:`FmuInstance` needs of a library: functions of FMI, here of one in another process."""

    def __init__(self, guest: GuestProcess, library: bytes, name: str, guid: str, resources: str) -> None:
        self._guest, self._name = guest, name
        self._arguments = library, name.encode(), guid.encode(), resources.encode()
        self.component = guest.address
        self.dll = self

    def __getattr__(self, function: str) -> Callable[..., int]:
        if not function.startswith("fmi2"):
            raise AttributeError(function)
        return lambda _instance, *arguments: self._guest.call(function, *arguments)

    def instantiate(self, callbacks: fmi2CallbackFunctions, loggingOn: bool) -> None:
        """fmi2Instantiate, as of FMPy.  Raises Exception if that fails."""
        self._guest.listen(self._name, callbacks)
        if self._guest.call("fmi2Instantiate", *self._arguments) != OK:
            raise Exception("Failed to instantiate model")

    def freeInstance(self) -> None:
        """fmi2FreeInstance."""
        self.fmi2FreeInstance(self.component)


class IsolatedInstance(FmuInstance):
    """An instance in a process of its own.  Whatever happens to that process is a :class:`SlaveError` here."""

    shares_process = False

    def __init__(self, component: Component, description: ModelDescription, timeouts_s: tuple[float, float]) -> None:
        self._timeouts_s = timeouts_s
        self._guest: GuestProcess | None = None
        try:
            super().__init__(component, description)
        except BaseException:
            if self._guest is not None:
                self._guest.close()
            raise
        self._names = {(FAMILY[v.type], v.valueReference): name for name, v in reversed(self.variables.items())}

    @property
    def guest(self) -> GuestProcess:
        """Its process."""
        assert self._guest is not None
        return self._guest

    def _load(self, component: Component, description: ModelDescription) -> _RemoteLibrary:
        library = find_binary(component, description, self._folder).absolute()
        self._guest = GuestProcess(self._timeouts_s, self._show)
        resources = (self._folder / "resources").absolute().as_uri()
        return _RemoteLibrary(self._guest, os.fsencode(library), component.name, description.guid, resources)

    def _show(self, line: str) -> None:
        self.messages.show(f"[output] {line}")

    def _instantiate(self) -> None:
        try:
            super()._instantiate()
        except SlaveError as error:
            if self.guest.fate == guest_process.ALIVE:
                raise
            self._raise_end(None, error.messages)

    def _call(self, function: str, *arguments: Any, time: float | None = None, variables: Sequence[str] = ()) -> None:
        if self.phase not in (InstancePhase.FATAL, InstancePhase.FREED):
            self.check(function, self.guest.flush(), time)
        super()._call(function, *arguments, time=time, variables=variables)

    def find_address(self, function: str) -> int:
        """That of the stand-in in C, which puts off what it can, for the plan of the steps."""
        stand_in = getattr(load_library(), function.replace("fmi2", "later_"))
        address = ctypes.cast(stand_in, ctypes.c_void_p).value
        assert address is not None
        return address

    def check(self, function: str, status: int, time: float | None, variables: Sequence[str] = ()) -> None:
        """As :meth:`FmuInstance.check`, of all calls that the exchange has carried out."""
        if status == OK:
            return
        outcomes = self.guest.list_outcomes()
        if self.guest.fate != guest_process.ALIVE:
            self._raise_end(time, self.messages.take())
        change, last = self.guest.change, self.guest.find_last_begun()
        begun = next((o.time for o in outcomes if o.time is not None), time)
        for place, outcome in enumerate(outcomes):
            names = self._name(outcome) or tuple(variables)
            when = time if outcome.function.startswith("fmi2Get") else begun
            if change and place == last:
                self._raise_change(outcome.function, when, change)
            if outcome.status not in (OK, -1):
                super().check(outcome.function, outcome.status, when, names)
        if status > WARNING and not any(o.status > WARNING for o in outcomes):  # no room in the shared memory
            super().check(function, status, time, variables)

    def _name(self, outcome: Outcome) -> tuple[str, ...]:
        family = outcome.function.removeprefix("fmi2")[3:]
        return tuple(self._names.get((family, r), f"reference {r}") for r in outcome.references)

    def _raise_change(self, function: str, time: float | None, change: str) -> NoReturn:
        self.phase = InstancePhase.FATAL
        raise SlaveError(
            f"{self.name}: {function}{at_time(time)} {change}\n  Report this fault to the maker of the FMU.",
            component=self.name, function=function, status=FATAL, time=time, messages=self.messages.take(),
        )  # fmt: skip

    def _raise_end(self, time: float | None, messages: Sequence[str]) -> NoReturn:
        self.phase = InstancePhase.FATAL
        outcomes, place = self.guest.list_outcomes(), self.guest.find_last_begun()
        outcome = outcomes[min(place, len(outcomes) - 1)]
        when = next((o.time for o in outcomes[place:] if o.time is not None), time)
        where = f"{self.name}: {outcome.function}{at_time(when)}"
        if self.guest.fate == guest_process.INTERRUPTED:
            raise KeyboardInterrupt(f"{where} was interrupted; its process has been ended")
        text = self.guest.describe_end()
        if self.guest.fate == guest_process.HANGS:
            text += f" within {self.guest.find_limit(outcome.function):g} s; its process has been ended"
        self.guest.join_output()
        lines = (*messages, *(f"[output] {line}" for line in self.guest.lines))
        raise SlaveError(
            f"{where} {text}{quote(lines)}",
            component=self.name, function=outcome.function, status=FATAL, time=when, messages=lines,
        )  # fmt: skip

    def free(self) -> None:
        """As :meth:`FmuInstance.free`, and end the process.  Raises :class:`SlaveError` if that ended by itself."""
        alive = self.guest.fate == guest_process.ALIVE
        corrupt = self.phase is InstancePhase.FATAL
        try:
            super().free()
            if alive and self.guest.fate != guest_process.ALIVE:
                self._raise_end(None, self.messages.take())
        finally:
            if corrupt:  # its library is not in this process, so nothing of it stays
                forget(self._callbacks)
                release_unpacked(self._folder)
                self.phase = InstancePhase.FREED
            self.guest.close()


def find_maker(isolation: Isolation | None, system: System) -> Callable[[Component, ModelDescription], FmuInstance]:
    """What loads the FMUs of a system: into this process, or as :class:`Isolation` says.

    Raises :class:`UsageError` as :meth:`Isolation.check`.
    """
    if isolation is None:
        return FmuInstance
    isolation.check(system)
    return isolation.make_instance


# ---- the options of commands ----------------------------------------------------------------------------------------


LONGEST_S = 1e6


def add_isolation_options(parser: argparse._ActionsContainer) -> None:
    """Add the options; :func:`make_isolation` takes what was given."""
    chosen = parser.add_mutually_exclusive_group()
    chosen.add_argument(
        "--isolate", action="store_true",
        help="run each FMU in a process of its own: what it does there ends no more than the run, and results so far "
        "are kept",
    )  # fmt: skip
    chosen.add_argument(
        "--isolate-only", action="append", default=[], metavar="NAME",
        help="do so with the FMU of this component; may be repeated",
    )  # fmt: skip
    parser.add_argument(
        "--step-timeout", type=float, metavar="S",
        help=f"end the run when a call of an isolated FMU in a step takes longer, in seconds ({STEP_TIMEOUT_S:g})",
    )  # fmt: skip
    parser.add_argument(
        "--call-timeout", type=float, metavar="S",
        help="the same for all other calls: to instantiate, initialise, terminate and free an FMU, in seconds "
        f"({CALL_TIMEOUT_S:g}, or the time-out of a step if that is longer)",
    )  # fmt: skip


def make_isolation(
    isolate: bool | Collection[str], step_timeout: float | None = None, call_timeout: float | None = None
) -> Isolation | None:
    """Which FMUs get processes of their own; None if none does.

    Parameters
    ----------
    isolate: the names of their components; True: all.
    step_timeout, call_timeout: of a call in a step, and of any other [s]; None: the usual ones.

    Raises :class:`UsageError`: a time-out that is no time, or without isolated FMUs.
    """
    timeouts = {"--step-timeout": step_timeout, "--call-timeout": call_timeout}
    given = {name: value for name, value in timeouts.items() if value is not None}
    if not isolate:
        for name in given:
            raise UsageError(f"{name}: needs --isolate: only an FMU in a process of its own can be ended")
        return None
    for name, value in given.items():
        if not (math.isfinite(value) and 0.0 < value <= LONGEST_S):
            raise UsageError(f"{name}: expected a time above 0 s and up to {LONGEST_S:g} s, got {value!r}")
    named = None if isinstance(isolate, bool) else frozenset(isolate)
    return Isolation(named, STEP_TIMEOUT_S if step_timeout is None else step_timeout, call_timeout)
