"""What an instance has to answer: the states and rules of FMI 2.0.4, and the slave's own class driven in Python."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import inf, isfinite
from typing import Any

from ps_fmu.slavekit.author.slave import LifePhase, ModelError, Refused, Slave
from ps_fmu.slavekit.author.state import SlaveState
from support.fmi_calls.caller import ERROR, OK, Answer, Caller, Message

ALLOWED = {
    "SetupExperiment": {LifePhase.INSTANTIATED},
    "EnterInitializationMode": {LifePhase.INSTANTIATED},
    "ExitInitializationMode": {LifePhase.INITIALISATION},
    "DoStep": {LifePhase.STEPPING},
    "Terminate": {LifePhase.STEPPING},
}
"""In which phases the standard allows a call (FMI 2.0.4, section 4.2.4); all others are allowed in each of them.

stepComplete and error are one phase here: a step that is refused changes nothing.  Beyond the standard, values
may be read before the initialisation mode: they are the start values.
"""

SETTABLE = {
    "parameter": {LifePhase.INSTANTIATED, LifePhase.INITIALISATION},
    "input": {LifePhase.INSTANTIATED, LifePhase.INITIALISATION, LifePhase.STEPPING},
    "output": set(),
    "local": set(),
}
"""In which phases variables may be set: fixed parameters with initial = exact, inputs, calculated outputs."""


@dataclass
class Known:
    """What follows from the calls so far without looking into the slave."""

    phase: LifePhase
    is_set_up: bool
    values: dict[int, Any]
    """Parameters and inputs by value reference."""
    time: float
    """End of the last successful step, or start."""
    stop: float


class Twin:
    """One instance in Python next to the FMU's; ``known`` is kept apart from it."""

    def __init__(self, make: Callable[[], Slave], listens: bool, logging: bool) -> None:
        self.make = make
        self.listens = listens  # the host has given a logger
        self.logging = logging
        self.categories: list[str] = []
        self.states: dict[int, tuple[SlaveState, Known]] = {}  # by address
        self.reset()

    def reset(self) -> None:
        """As after instantiation; the states stay."""
        self.slave = self.make()
        self.ports = self.slave.layout.by_reference
        given = ("input", "parameter")
        start = {reference: port.start for reference, port in self.ports.items() if port.causality in given}
        self.known = Known(LifePhase.INSTANTIATED, False, start, 0.0, inf)

    def outcome(self, action: Callable[[], Any]) -> tuple[int, Any, list[Message]]:
        """Status, result and messages.  Whatever is raised but a refusal is a fault of the slave, and passes."""
        status, result, refusal = OK, None, None
        try:
            result = action()
        except (Refused, ModelError) as error:
            status, refusal = ERROR, f"{self.slave.label}: {error}"
        logged = [(m.status.value, m.category, m.msg.replace("%%", "%")) for m in self.slave.log_queue]
        self.slave.log_queue.clear()
        if refusal is not None:  # see guard.escape
            told = [refusal, *(f"before that: {words}" for _, _, words in logged)]
            logged = [(ERROR, "logStatusError", "\n".join(told))]
        return status, result, self.heard(logged)

    def heard(self, messages: list[Message]) -> list[Message]:
        """Those that the host wants to hear."""
        wanted = self.categories
        everything = not wanted or "logAll" in wanted
        return [m for m in messages if self.listens and self.logging and (everything or m[1] in wanted)]

    # --- Rules --------------------------------------------------------------------------

    def allows(self, function: str) -> bool:
        """Does the standard allow this call now?"""
        if function == "EnterInitializationMode" and not self.known.is_set_up:
            return False
        return self.known.phase in ALLOWED.get(function, set(LifePhase))

    def allows_reading(self, kind: str, references: list[int]) -> bool:
        """Are all of these variables there, and of this type?"""
        return all(vr in self.ports and self.ports[vr].type == kind for vr in references)

    def allows_writing(self, kind: str, references: list[int], values: list[Any]) -> bool:
        """May all of these be set, now and to this?"""
        return self.allows_reading(kind, references) and all(
            self.known.phase in SETTABLE[self.ports[vr].causality] and self._is_possible(vr, value)
            for vr, value in zip(references, values, strict=True)
        )

    def _is_possible(self, reference: int, value: Any) -> bool:
        port = self.ports[reference]
        if port.type in ("Boolean", "String"):
            return True
        low = -inf if port.min is None else port.min
        high = inf if port.max is None else port.max
        return isfinite(value) and low <= value <= high

    def allows_step(self, time: float, step: float) -> bool:
        """Is this the next communication point, and its end not beyond the stop time?"""
        known = self.known
        return (
            self.allows("DoStep")
            and isfinite(step)
            and step > 0.0
            and abs(time - known.time) <= 1e-3 * step
            and time + step <= known.stop + 1e-3 * step + 4e-16 * abs(time)
        )

    # --- What changes -------------------------------------------------------------------

    def has_set(self, references: list[int], values: list[Any]) -> None:
        """These variables were set."""
        self.known.values.update(zip(references, values, strict=True))

    def save(self, address: int, state: SlaveState) -> None:
        """A state of now was handed out."""
        known = replace(self.known, values=dict(self.known.values))
        self.states[address] = (state, known)

    def read_in(self, address: int, state: SlaveState) -> None:
        """A state was made from bytes; what it holds is known from it alone."""
        clock, numbers, size = state.clock, state.buffer, self.slave.layout.size
        values = {
            vr: state.strings[vr - size] if vr >= size else type(port.start)(numbers[vr])
            for vr, port in self.ports.items()
            if port.causality in ("input", "parameter")
        }
        self.states[address] = (state, Known(clock.phase, clock.ready, values, clock.time, clock.stop))

    def restore(self, address: int) -> None:
        """A state was set."""
        known = self.states[address][1]
        self.known = replace(known, values=dict(known.values))


PLACES = 4  # for states


class Comparison:
    """An FMU in another process, and the twins of its instances by their places there."""

    def __init__(self, caller: Caller, model: type[Slave], guid: str) -> None:
        self.caller = caller
        self.model = model
        self.guid = guid
        self.twins: dict[int, Twin] = {}
        self.addresses = [0] * PLACES  # what lies in the places for states
        self.contents = [b"", b"no state"]  # serialised states so far
        self.statuses: dict[tuple[str, int], int] = {}  # how often each call had each status

    def call(self, function: str, instance: int, *arguments: str | int | None) -> Answer:
        answer = self.caller(function, instance if instance in self.twins else None, *arguments)
        key = (function, answer.status)
        self.statuses[key] = self.statuses.get(key, 0) + 1
        return answer

    def compare(
        self,
        function: str,
        instance: int,
        answer: Answer,
        action: Callable[[], Any],
        fault: bool = False,
        allowed: bool = True,
        certain: bool = False,
    ) -> Any:
        """Compare with what the twin does; returns its result, None if it refused.

        Parameters
        ----------
        fault: the arguments are such that the launcher has to refuse by itself
        allowed: False: must be refused
        certain: must not be refused: no model can object
        """
        if instance not in self.twins:
            assert (answer.status, answer.messages) == (ERROR, []), f"{function} without an instance: {answer}"
            return None
        twin = self.twins[instance]
        if fault:
            assert answer.status == ERROR, f"{function} with impossible arguments: {answer}"
            told = [(status, category, words.split(": ")[0]) for status, category, words in answer.messages]
            assert told == twin.heard([(ERROR, "logStatusError", f"fmi2{function}")]), answer
            return None
        status, result, messages = twin.outcome(action)
        assert answer.status == status, f"{function}: {answer}, expected status {status}, {messages}"
        assert answer.messages == messages, f"{function}: {answer}, expected {messages}"
        assert allowed or status != OK, f"{function} is not allowed now"
        assert not certain or status == OK, f"{function} has to be possible: {answer}"
        return result if status == OK else None
