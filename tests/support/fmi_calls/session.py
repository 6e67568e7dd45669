"""A method for each FMI call: made to the FMU, done to its twin, compared."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ps_fmu.slavekit.author.core import REFERENCE
from ps_fmu.slavekit.author.slave import LifePhase, Slave
from support.fmi_calls.caller import DISCARD, ERROR, OK, Caller, double, item, listed, read, text
from support.fmi_calls.comparison import PLACES
from support.fmi_calls.states import StateCalls
from support.fmi_calls.twin import Twin

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
        by_model = twin is None or any(twin.ports[vr].causality == "output" for vr in references if vr in twin.ports)
        certain = allowed and (not by_model or twin.known.phase >= LifePhase.STEPPING)
        read_from = lambda: getattr(twin.slave, f"get_{kind.lower()}")(signed(references))  # noqa: E731
        expected = self.compare(f"Get{kind}", instance, answer, read_from, fault, allowed, certain)
        if expected is None:
            return
        assert answer.got == [item(kind, value) for value in expected]
        for reference, value in zip(references, read(kind, answer.got), strict=True):
            if reference in twin.known.values:
                assert value == twin.known.values[reference], f"{twin.ports[reference].name} was set to another value"
            elif kind == "Real":
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
