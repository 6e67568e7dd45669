"""Calls of FMUs in this process that do not return: the library of the loop gets the master out of them.

See ``native/guard.c``.  Where there is no such library, an FMU that crashes or exits takes the process along.
"""

from __future__ import annotations

import ctypes
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import Structure, c_char, c_int, c_void_p
from functools import cache

from fmpy import platform

from .native import LOOP

CRASHED, EXITED, INTERRUPTED = 1, 2, 3
"""Endings of a call, as in guard.c."""
ROUNDING, HANDLER = 1, 2
"""What FMUs have changed in this process, as bits."""
_PLACE_BYTES = 256


class End(Structure):
    """``End`` of guard.c: how a call ended, with the number of the signal or the exit code."""

    _fields_ = (("ending", c_int), ("number", c_int))

    def describe(self) -> str:
        """The predicate of a sentence about the call."""
        if self.ending == CRASHED:
            return f"crashed with {signal.Signals(self.number).name}"
        if self.ending == EXITED:
            return f"called exit({self.number})"
        return "did not return, and was interrupted"


@cache
def load_library() -> ctypes.CDLL:
    """The library of the loop.  Raises OSError if there is none for this platform, or none that can be loaded."""
    path = LOOP.path(platform)
    if path is None:
        raise OSError(f"there is no compiled loop for {platform}")
    library = ctypes.CDLL(str(path))
    library.guard_prepare.argtypes, library.guard_prepare.restype = (c_void_p,), None
    library.guard_prepare(ctypes.cast(ctypes.pythonapi.PyGILState_Check, c_void_p))
    return library


def find_library() -> ctypes.CDLL | None:
    """The same, or None."""
    try:
        return load_library()
    except OSError:
        return None


@contextmanager
def arm(interrupts: bool) -> Iterator[None]:
    """Take over the signals of crashes, and with ``interrupts`` SIGINT, which Python has a handler for."""
    library = find_library()
    if library is None:
        yield
        return
    library.guard_arm(interrupts)
    try:
        yield
    finally:
        library.guard_disarm(interrupts)


@contextmanager
def name_call(place: str) -> Iterator[None]:
    """If the process ends within, its last words name this place."""
    library = find_library()
    if library is None:
        yield
        return
    text = (c_char * _PLACE_BYTES).in_dll(library, "guard_place")
    before, text.value = text.value, place.encode()[: _PLACE_BYTES - 1]
    try:
        yield
    finally:
        text.value = before


def find_interrupts() -> int | None:
    """Address of the number of Ctrl-C since the guard was armed; None where there is no library."""
    library = find_library()
    return None if library is None else ctypes.addressof(c_int.in_dll(library, "guard_interrupts"))


def restore_process(interrupts: bool) -> int:
    """Put back what no FMU may change, and say which of it was changed: ROUNDING, HANDLER."""
    library = find_library()
    return 0 if library is None else int(library.guard_restore(interrupts))
