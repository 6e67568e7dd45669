"""A call of an FMU, and what its twin says to it: same status, same values to the bit, same messages."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ps_fmu.slavekit.author.slave import Slave
from support.fmi_calls.caller import ERROR, OK, Answer, Caller
from support.fmi_calls.twin import Twin

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
