"""Calls of FMUs in this process that do not return: the library of the loop gets the master out of them.

See ``native/guard.c``.  Where there is no such library, an FMU that crashes or exits takes the process along.
"""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from ctypes import Structure, c_char, c_int, c_void_p
from functools import cache

from fmpy import platform

from .errors import CosimError
from .native import LOOP

log = logging.getLogger("ps_fmu.cosim")

CRASHED, EXITED, INTERRUPTED, LEFT, THREAD_ENDED = range(1, 6)
"""Endings of a call, as in guard.c."""
ROUNDING, HANDLER, FOLDER, CONTROL_WORD = 1, 2, 4, 8
"""What FMUs have changed in this process, as bits."""
_CHANGED_WORD = "the control word of the processor (flush-to-zero, as code of -ffast-math does)"
_CHANGES = {HANDLER: "the handler of Ctrl-C", FOLDER: "the working directory", CONTROL_WORD: _CHANGED_WORD}
_ADVICE = "--isolate gives FMUs processes of their own, and tells which of them does this"
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
        if self.ending == LEFT:
            return f"called _exit({self.number})"
        if self.ending == THREAD_ENDED:
            return "ended the thread of the master by pthread_exit()"
        return "did not return, and was interrupted"


@cache
def load_library() -> ctypes.CDLL:
    """The library of the loop.  Raises OSError if there is none for this platform, or none that can be loaded."""
    path = LOOP.find_whole(platform)
    if path is None:
        raise OSError(f"there is no compiled loop for {platform}")
    library = ctypes.CDLL(str(path))
    library.guard_prepare.argtypes, library.guard_prepare.restype = (c_void_p,), None
    library.guard_list_loaded.argtypes, library.guard_list_loaded.restype = (), c_void_p
    library.guard_divert.argtypes, library.guard_divert.restype = (c_void_p,), c_int
    library.guard_prepare(ctypes.cast(ctypes.pythonapi.PyGILState_Check, c_void_p))
    return library


def find_library() -> ctypes.CDLL | None:
    """The same, or None."""
    try:
        return load_library()
    except OSError:
        return None


@cache
def _load_locked() -> ctypes.PyDLL:
    """The library for calls that keep the interpreter's lock: one thread at a time counts."""
    return ctypes.PyDLL(str(LOOP.find_whole(platform)))


@contextmanager
def arm(interrupts: bool) -> Iterator[None]:
    """Take over the signals of crashes, and with ``interrupts`` SIGINT, which Python has a handler for."""
    if find_library() is None:
        yield
        return
    library = _load_locked()
    library.guard_arm(interrupts)
    try:
        yield
    finally:
        library.guard_disarm(interrupts)


class NamedCall:
    """If the process ends within, its last words name this place; threads have places of their own.

    A function with contextlib takes 3 us more.
    """

    __slots__ = ("_before", "_place", "_process")
    _left = (c_char * _PLACE_BYTES)()  # nobody reads it

    def __init__(self, place: str) -> None:
        self._process = os.getpid()
        self._place, self._before = place, None if find_library() is None else (c_char * _PLACE_BYTES)()

    def __enter__(self) -> None:
        if self._before is not None:
            _load_locked().guard_name(self._place.encode()[: _PLACE_BYTES - 1], self._before)

    def __exit__(self, *_: object) -> None:
        if os.getpid() != self._process:  # it would go on with the run, and write into the same files
            text = f"{self._place}: a copy of the process, made by fork(), came back from the call, and was ended\n"
            os.write(2, text.encode())
            os._exit(1)
        if self._before is not None:
            _load_locked().guard_name(self._before, self._left)


@contextmanager
def divert_ends(name: str) -> Iterator[None]:
    """The library of the FMU ``name`` is loaded within: what it calls to end process or thread leads to the guard.

    How this thread computes with floating-point numbers is put back.
    """
    library = find_library()
    if library is None:
        yield
        return
    before = library.guard_list_loaded()
    try:
        yield
    finally:
        if library.guard_divert(before):
            log.warning("%s: loading the library changed %s, which was put back", name, _CHANGED_WORD)


def find_interrupts() -> int | None:
    """Address of the number of Ctrl-C since the guard was armed; None where there is no library."""
    library = find_library()
    return None if library is None else ctypes.addressof(c_int.in_dll(library, "guard_interrupts"))


def _find_folder() -> str | None:
    """The working directory; None if it has been removed."""
    try:
        return os.getcwd()
    except OSError:
        return None


class ProcessGuard:
    """What no FMU may change in the process of the master: compared with what it was, and put back."""

    def __init__(self) -> None:
        self._library = find_library()
        self._folder = _find_folder()
        self._null = os.open(os.devnull, os.O_RDONLY)
        self._close = weakref.finalize(self, os.close, self._null)
        self._warned = 0

    def check(self) -> None:
        """Look after some steps.  Rounding and descriptors are errors, for results after them cannot be trusted.

        Raises :class:`CosimError`.
        """
        found = 0 if self._library is None else int(self._library.guard_restore())
        if self._folder is not None and _find_folder() != self._folder:
            os.chdir(self._folder)
            found |= FOLDER
        for change, text in _CHANGES.items():
            if found & change & ~self._warned:
                log.warning("an FMU changed %s of this process, which was put back; %s", text, _ADVICE)
        self._warned |= found
        if found & ROUNDING:
            raise CosimError(f"an FMU changed the rounding of numbers in this process in the last steps; {_ADVICE}")
        try:
            os.fstat(self._null)
        except OSError as error:
            self._close.detach()
            raise CosimError(f"an FMU closed files of this process in the last steps; {_ADVICE}") from error
