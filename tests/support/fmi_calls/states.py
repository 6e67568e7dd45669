"""The calls of a session that have to do with FMU states."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from ps_fmu.slavekit.author.guard import Unreadable
from ps_fmu.slavekit.author.state import SlaveState, to_bytes
from support.fmi_calls.caller import Answer, text
from support.fmi_calls.comparison import Comparison
from support.fmi_calls.twin import Twin

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
