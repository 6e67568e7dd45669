"""A method for each FMI call: made to the FMU, done to its twin, compared."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Sequence
from typing import Any

from ps_fmu.slavekit.author.core import REFERENCE
from ps_fmu.slavekit.author.guard import Unreadable
from ps_fmu.slavekit.author.slave import LifePhase, Slave
from ps_fmu.slavekit.author.state import SlaveState, to_bytes
from support.fmi_calls.caller import DISCARD, ERROR, OK, Answer, Caller, double, item, listed, read, text
from support.fmi_calls.twin import PLACES, Comparison, Twin

Mutation = Callable[[bytes], bytes]


def sealed(content: bytes) -> bytes:
    """A serialised state with a checksum that fits."""
    return content[:-32] + hashlib.sha256(content[:-32]).digest()


class StateCalls(Comparison):
    """``place``: where the state lies; None: NULL is passed."""

    def put(self, place: int, address: int) -> None:
        """Not a call: any address in a place for a state."""
        self.caller("Put", place, f"{address:x}")
        self.addresses[place] = address

    def copy(self, source: int, place: int) -> None:
        """Not a call: a state in a second place, where it stays when it is freed in the first."""
        self.put(place, self.addresses[source])

    def get_state(self, instance: int, place: int | None) -> None:
        """fmi2GetFMUstate; what the place holds, if it is a state of this instance, is freed."""
        answer = self.call("GetFMUstate", instance, place)
        twin = self.twins.get(instance)
        take = lambda: twin.slave._get_fmu_state()  # noqa: E731
        state = self.compare("GetFMUstate", instance, answer, take, place is None, certain=place is not None)
        if state is not None:
            twin.save(self._handed_out(twin, place, answer), state)

    def _handed_out(self, twin: Twin, place: int, answer: Answer) -> int:
        address = int(answer.got[0], 16)
        assert all(address not in one.states for one in self.twins.values()), "one state was handed out twice"
        twin.states.pop(self.addresses[place], None)
        self.addresses[place] = address
        return address

    def checkpoint(self, instance: int, place: int) -> None:
        """A state and its bytes."""
        self.get_state(instance, place)
        self.serialise(instance, place, 0)

    def set_state(self, instance: int, place: int | None) -> None:
        """fmi2SetFMUstate with what is in a place."""
        answer = self.call("SetFMUstate", instance, place)
        twin = self.twins.get(instance)
        address = 0 if place is None else self.addresses[place]

        def action() -> None:
            twin.slave._set_fmu_state(twin.states[address][0])
            twin.restore(address)

        self.compare("SetFMUstate", instance, answer, action, twin is not None and address not in twin.states)

    def rewind(self, instance: int, place: int) -> None:
        """fmi2SetFMUstate with the last state of this instance, if it has one."""
        for address in list(self.twins[instance].states)[-1:] if instance in self.twins else ():
            self.put(place, address)
            self.set_state(instance, place)

    def free_state(self, instance: int, place: int | None) -> None:
        """fmi2FreeFMUstate."""
        answer = self.call("FreeFMUstate", instance, place)
        twin = self.twins.get(instance)
        address = 0 if place is None else self.addresses[place]
        fault = address != 0 and twin is not None and address not in twin.states
        self.compare("FreeFMUstate", instance, answer, lambda: None, fault, certain=True)
        if twin is not None and not fault and place is not None:
            assert int(answer.got[0], 16) == 0
            twin.states.pop(address, None)
            self.addresses[place] = 0

    def serialise(self, instance: int, place: int | None, room: int | None, size: int | None = None) -> None:
        """fmi2SerializedFMUstateSize, then fmi2SerializeFMUstate.

        Parameters
        ----------
        room: bytes to have beyond those needed, perhaps below 0; None: NULL
        size: what to say that there is, if not the truth
        """
        twin = self.twins.get(instance)
        address = 0 if place is None else self.addresses[place]
        fault = twin is not None and address not in twin.states
        content = to_bytes(twin.states[address][0]) if twin is not None and not fault else bytes(500)
        answer = self.call("SerializedFMUstateSize", instance, place, "+")
        needed = self.compare("SerializedFMUstateSize", instance, answer, lambda: len(content), fault, certain=True)
        assert needed is None or answer.got == [str(needed)]

        there = None if room is None else max(len(content) + room, 0)
        size = (there or 0) if size is None else size
        if there is not None and size > there and size >= len(content):
            there = len(content)  # a lie that does no harm
        answer = self.call("SerializeFMUstate", instance, place, there, size)
        too_small = there is None or size < len(content)
        result = self.compare(
            "SerializeFMUstate", instance, answer, lambda: content, fault or too_small, certain=not (fault or too_small)
        )
        if result is not None:
            assert bytes.fromhex(answer.got[0][1:])[: len(content)] == content
            self.contents.append(content)

    def deserialise(
        self, instance: int, place: int | None, which: int, mutation: Mutation | None = None, size: int | None = None
    ) -> None:
        """fmi2DeSerializeFMUstate of what was serialised before (0: last), or of a mutation of it.

        ``size`` given: of NULL, and so many bytes.
        """
        content = self.contents[-1 - which % len(self.contents)]
        content = mutation(content) if mutation is not None else content
        length, data = (len(content), text(content)) if size is None else (size, None)
        answer = self.call("DeSerializeFMUstate", instance, place, length, data)
        twin = self.twins.get(instance)
        fault = place is None or size is not None

        def take() -> SlaveState:
            state = twin.slave._fmu_state_from_bytes(content)
            if isinstance(state, Unreadable):
                twin.slave._set_fmu_state(state)  # raises
            return state

        state = self.compare("DeSerializeFMUstate", instance, answer, take, fault)
        if state is not None:
            assert to_bytes(state) == content
            twin.read_in(self._handed_out(twin, place, answer), state)


INSTANCES = 3  # places; one more is never filled
MOST_VALUES = 2**24  # in one call, see launcher.c
Nulls = tuple[bool, bool]
"""Pass NULL for the references, for the values or their places?"""


class Session(StateCalls):
    """What is odd about a call is in its arguments.

    ``instance`` is a place, perhaps an empty one: then NULL is passed.  So is None for a list, a text, a place.
    """

    def __init__(self, caller: Caller, model: type[Slave], guid: str) -> None:
        super().__init__(caller, model, guid)
        for place in range(PLACES):
            self.put(place, 0)

    # --- Life cycle ---------------------------------------------------------------------

    def instantiate(
        self, instance: int, name: Any, kind: int = 1, guid: str | None = "", listens: bool = True, logging: bool = True
    ) -> None:
        """The GUID is the FMU's unless one is given; ``name`` is a text or bytes."""
        if instance in self.twins:
            self.free(instance)
        guid = self.guid if guid == "" else guid
        words = (text(name), kind, text(guid), text("file:///nowhere"), int(listens), int(logging))
        answer = self.caller("Instantiate", instance, *words)
        try:
            known_as = name.decode() if isinstance(name, bytes) else name
        except UnicodeDecodeError:
            known_as = None
        if not known_as or kind != 1 or guid != self.guid:
            assert answer.status == ERROR, answer
            assert [m[:2] for m in answer.messages] == [(ERROR, "logStatusError")] * (listens and logging), answer
            return
        assert (answer.status, answer.messages) == (OK, []), answer
        self.twins[instance] = Twin(lambda: self.model(instance_name=known_as), listens, logging)

    def advance(self, instance: int) -> None:
        """The next call in an ordinary life; nothing for the place that stays empty."""
        twin = self.twins.get(instance)
        if twin is None and instance < INSTANCES:
            self.instantiate(instance, "ordinary")
        elif twin is None:
            return
        elif twin.known.phase == LifePhase.INSTANTIATED and not twin.known.is_set_up:
            self.set_up(instance, 0.0)
        elif twin.known.phase == LifePhase.INSTANTIATED:
            self.change(instance, "EnterInitializationMode")
        elif twin.known.phase == LifePhase.INITIALISATION:
            self.change(instance, "ExitInitializationMode")
        elif twin.known.phase == LifePhase.STEPPING:
            self.step(instance, 0.0, 0.01)
        else:
            self.reset(instance)

    def free(self, instance: int) -> None:
        """fmi2FreeInstance."""
        self.call("FreeInstance", instance)
        self.twins.pop(instance, None)

    def set_up(self, instance: int, start: float, stop: float | None = None, tolerance: float | None = None) -> None:
        """fmi2SetupExperiment."""
        optional = [(int(value is not None), double(0.0 if value is None else value)) for value in (tolerance, stop)]
        answer = self.call("SetupExperiment", instance, *optional[0], double(start), *optional[1])
        twin = self.twins.get(instance)

        def action() -> None:
            twin.slave.setup_experiment(start, stop, tolerance)
            twin.known.is_set_up = True
            twin.known.time = start
            twin.known.stop = float("inf") if stop is None else stop

        possible = abs(start) < float("inf") and (stop is None or stop > start)
        allowed = twin is not None and twin.allows("SetupExperiment") and possible
        self.compare("SetupExperiment", instance, answer, action, allowed=allowed, certain=allowed)

    def change(self, instance: int, function: str) -> None:
        """EnterInitializationMode, ExitInitializationMode, Terminate."""
        method, phase = {
            "EnterInitializationMode": ("enter_initialization_mode", LifePhase.INITIALISATION),
            "ExitInitializationMode": ("exit_initialization_mode", LifePhase.STEPPING),
            "Terminate": ("terminate", LifePhase.TERMINATED),
        }[function]
        answer = self.call(function, instance)
        twin = self.twins.get(instance)

        def action() -> None:
            getattr(twin.slave, method)()
            twin.known.phase = phase

        allowed = twin is not None and twin.allows(function)
        certain = allowed and function != "ExitInitializationMode"
        self.compare(function, instance, answer, action, allowed=allowed, certain=certain)

    def reset(self, instance: int) -> None:
        """fmi2Reset."""
        answer = self.call("Reset", instance)
        self.compare("Reset", instance, answer, lambda: self.twins[instance].reset(), certain=True)

    def step(self, instance: int, off: float, step: float) -> None:
        """fmi2DoStep from ``off`` (s) beside the right time."""
        twin = self.twins.get(instance)
        time = (twin.known.time if twin is not None else 0.0) + off
        answer = self.call("DoStep", instance, double(time), double(step))

        def action() -> None:
            twin.slave.do_step(time, step)
            twin.known.time = time + step

        allowed = twin is not None and twin.allows_step(time, step)
        self.compare("DoStep", instance, answer, action, allowed=allowed)

    def march(self, instance: int, n: int, step: float) -> None:
        """Equal steps, all but the first of which the launcher makes without Python if nothing is due."""
        for _ in range(n):
            self.step(instance, 0.0, step)

    # --- Variables ----------------------------------------------------------------------

    def get(
        self, instance: int, kind: str, references: list[int], n: int | None = None, null: Nulls = (False, False)
    ) -> None:
        """fmi2Get<kind>; ``n``: another length than the list has; ``null``: pass NULL for references, for places."""
        length = len(references) if n is None else n
        listing = listed("Reference", None if null[0] else references)
        answer = self.call(f"Get{kind}", instance, length, listing, None if null[1] else "+")
        twin = self.twins.get(instance)
        fault = length > MOST_VALUES or (length > 0 and any(null)) or (kind == "String" and REFERENCE in references)
        allowed = twin is not None and twin.allows_reading(kind, references)
        computed = ("output", "local")
        by_model = twin is None or any(twin.ports[vr].causality in computed for vr in references if vr in twin.ports)
        certain = allowed and (not by_model or twin.known.phase >= LifePhase.STEPPING)
        read_from = lambda: getattr(twin.slave, f"get_{kind.lower()}")(signed(references))  # noqa: E731
        expected = self.compare(f"Get{kind}", instance, answer, read_from, fault, allowed, certain)
        if expected is None:
            return
        assert answer.got == [item(kind, value) for value in expected]
        for reference, value in zip(references, read(kind, answer.got), strict=True):
            if reference in twin.known.values:
                assert value == twin.known.values[reference], f"{twin.ports[reference].name} was set to another value"
            elif kind == "Real" and reference < twin.slave.layout.first_rate:  # a rate may be unknown: NaN
                assert abs(value) < float("inf"), f"{twin.ports[reference].name} = {value}"

    def set(
        self,
        instance: int,
        kind: str,
        references: list[int],
        values: Sequence[Any],
        n: int | None = None,
        null: Nulls = (False, False),
    ) -> None:
        """fmi2Set<kind>, as :meth:`get`; texts may be bytes, or None for NULL."""
        length = len(references) if n is None else n
        lists = listed("Reference", None if null[0] else references), listed(kind, None if null[1] else values)
        answer = self.call(f"Set{kind}", instance, length, *lists)
        twin = self.twins.get(instance)
        fault = length > MOST_VALUES or (length > 0 and any(null))
        if kind == "String" and not fault:
            fault = any(value is None or not is_utf8(value) for value in values)
            values = values if fault else [v.decode() if isinstance(v, bytes) else v for v in values]
        if kind == "Boolean":
            values = list(map(bool, values))
        allowed = not fault and twin is not None and twin.allows_writing(kind, references, list(values))

        def action() -> None:
            getattr(twin.slave, f"set_{kind.lower()}")(signed(references), list(values))
            twin.has_set(references, list(values))

        self.compare(f"Set{kind}", instance, answer, action, fault, allowed, certain=allowed)

    # --- The rest -----------------------------------------------------------------------

    def set_logging(
        self, instance: int, logging: bool, categories: list[str | None] | None, n: int | None = None
    ) -> None:
        """fmi2SetDebugLogging; ``n``: another length than the list has."""
        length = (0 if categories is None else len(categories)) if n is None else n
        answer = self.call("SetDebugLogging", instance, int(logging), length, listed("String", categories))
        twin = self.twins.get(instance)

        def action() -> None:
            twin.logging, twin.categories = logging, [name for name in categories or () if name is not None]

        fault = length > MOST_VALUES or (length > 0 and categories is None)
        self.compare("SetDebugLogging", instance, answer, action, fault, certain=not fault)

    def get_statuses(self, instance: int, kind: int, null: bool = False) -> None:
        """fmi2GetRealStatus and fmi2GetBooleanStatus."""
        twin = self.twins.get(instance)
        place = None if null else "+"
        answer = self.call("GetRealStatus", instance, kind, place)
        known = twin is not None and not null and kind == 2
        expected = (OK, [double(twin.known.time)]) if known else (DISCARD, [double(-1.0)])
        assert (answer.status, answer.got, answer.messages) == (*expected, [])
        answer = self.call("GetBooleanStatus", instance, kind, place)
        known = twin is not None and not null and kind == 3
        assert (answer.status, answer.got, answer.messages) == ((OK, ["0"], []) if known else (DISCARD, ["-1"], []))

    def unsupported(self, instance: int) -> None:
        """All that this FMU has no use for."""
        answer = self.call("Unsupported", instance)
        assert answer.got == [str(status) for status in (*[ERROR] * 4, *[DISCARD] * 3)]
        heard = self.twins[instance].heard([(ERROR, "logStatusError", "")] * 4) if instance in self.twins else []
        assert len(answer.messages) == len(heard)


def signed(references: Sequence[int]) -> list[int]:
    """Value references as pythonfmu's library passes them on."""
    return [vr - 2**32 if vr >= 2**31 else vr for vr in references]


def is_utf8(value: str | bytes) -> bool:
    """Can these bytes be decoded?"""
    try:
        value.decode() if isinstance(value, bytes) else value.encode()
    except UnicodeError:
        return False
    return True
