"""What FMUs say through the FMI logger: kept for error messages, shown once.

FMPy formats the text of a message in a native proxy that knows a single Python function per process, so one
function serves all instances; ``componentEnvironment`` tells it which of them speaks.
"""

from __future__ import annotations

import itertools
import logging
from collections import deque
from collections.abc import Iterable
from ctypes import byref

from fmpy import calloc, free
from fmpy.fmi1 import printLogMessage
from fmpy.fmi2 import (
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from ..terminal import escape_controls
from .errors import name_status

log = logging.getLogger("ps_fmu.cosim")

KEPT = 8
"""Messages of an instance that an error repeats."""
REMEMBERED = 200
"""Different messages of an instance that are shown; a chatty FMU is cut off, so that memory stays flat."""


class MessageLog:
    """Messages of one instance.

    Warnings are logged when they come, each text once.  Errors are held for the exception that they explain;
    :meth:`show_held` logs those that no exception took.
    """

    def __init__(self, component: str) -> None:
        self.component = component
        self._recent: deque[str] = deque(maxlen=KEPT)
        self._held: deque[str] = deque(maxlen=KEPT)
        self._shown: set[str] = set()

    def add(self, status: int, category: str, text: str) -> None:
        """Take a message of the FMU."""
        line = f"[{name_status(status)}] " + "\n".join(map(escape_controls, text.strip().splitlines()))
        if status == 0:
            log.debug("%s: %s", self.component, line)
            return
        self._recent.append(line)
        if status == 1:
            self.show(line)
        else:
            self._held.append(line)

    def take(self) -> tuple[str, ...]:
        """The last messages, for an exception."""
        self._held.clear()
        return tuple(self._recent)

    def show(self, line: str, time: float | None = None) -> None:
        """Log a warning, with the time [s] it came up first, unless this text has been logged before."""
        if line in self._shown or len(self._shown) > REMEMBERED:
            return
        self._shown.add(line)
        text = line.replace("\n", "\n    ")  # none of its lines can be taken for one of ours
        log.warning("%s: %s%s", self.component, text, "" if time is None else f", first at t = {time:.9g} s")
        if len(self._shown) > REMEMBERED:
            log.warning("%s: more different messages than are shown; the rest is counted", self.component)

    def list_shown(self) -> list[str]:
        """The texts that have been logged."""
        return sorted(self._shown)

    def note_shown(self, lines: Iterable[str]) -> None:
        """Take texts as logged, as by a run that is gone on with."""
        self._shown.update(itertools.islice(lines, REMEMBERED + 1))

    def show_held(self) -> None:
        """Log the errors that belong to no exception."""
        while self._held:
            self.show(self._held.popleft())


_listeners: dict[int, MessageLog] = {}
_numbers = itertools.count(1)


def _receive(environment: int | None, instance: bytes, status: int, category: bytes | None, text: bytes | None) -> None:
    listener = _listeners.get(environment or 0)
    if listener is None:  # an FMU that someone else loaded: what FMPy itself would have done
        printLogMessage(environment, instance, status, category, text or b"")
        return
    listener.add(status, _decode(category), _decode(text))


def _decode(raw: bytes | None) -> str:
    return "" if raw is None else raw.decode("utf-8", errors="replace")


# ctypes keeps no reference to a callback: these must live as long as any FMU.
_logger = fmi2CallbackLoggerTYPE(_receive)
_allocate = fmi2CallbackAllocateMemoryTYPE(calloc)
_free = fmi2CallbackFreeMemoryTYPE(free)


def listen(messages: MessageLog) -> fmi2CallbackFunctions:
    """Callbacks for ``fmi2Instantiate`` that report to ``messages``; end with :func:`forget`."""
    number = next(_numbers)
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = _logger
    callbacks.allocateMemory = _allocate
    callbacks.freeMemory = _free
    callbacks.componentEnvironment = number
    addLoggerProxy(byref(callbacks))
    _listeners[number] = messages
    return callbacks


def forget(callbacks: fmi2CallbackFunctions) -> None:
    """Stop listening to an instance that has been freed."""
    _listeners.pop(callbacks.componentEnvironment or 0, None)
