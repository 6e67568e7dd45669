"""FMUs in this process: how they may change it, and what is left when one of them ends it (``native/loop/guard.c``)."""

from __future__ import annotations

import ctypes
import logging
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from ctypes import POINTER, Structure, c_char_p, c_double, c_int, c_void_p
from functools import cache
from types import FrameType

from ..native import find_compiled, load
from .errors import CosimError

log = logging.getLogger("ps_fmu.cosim")

ROUNDING, CONTROL_WORD = 1, 2
"""What FMUs have changed in this process, as bits of guard.c."""
_CHANGED_WORD = "the control word of the processor (flush-to-zero, as code of -ffast-math does)"
_ADVICE = "--isolate runs each FMU in a process of its own, and names the FMU that does this"
_NUMBER_BYTES = 8

_keepers: list[tuple[int, Callable[[], None]]] = []  # of the runs that are under way, with their threads


class NamedStep(Structure):
    """``Call`` of guard.c: what the last words call an operation of the steps, and how much later it is [s]."""

    _fields_ = (("name", c_char_p), ("offset", c_double))


class Place(Structure):
    """``Place`` of guard.c: a call by its name, or one of the steps."""

    _fields_ = (
        ("text", c_char_p),
        ("calls", POINTER(NamedStep)),
        ("next", c_void_p),
        ("row", c_void_p),
        ("times", c_void_p),
    )


@cache
def load_library() -> ctypes.CDLL:
    """The library of the loop.  Raises :class:`CosimError`, with the command that makes it, where there is none."""
    try:
        library = load("loop")
    except OSError as error:
        raise CosimError(f"{error}\n  No steps can be run without it.  'make launcher' compiles it.") from error
    library.guard_prepare.argtypes, library.guard_prepare.restype = (c_void_p, c_void_p), None
    python = (ctypes.pythonapi.PyGILState_Check, ctypes.pythonapi.Py_IsInitialized)
    library.guard_prepare(*(ctypes.cast(function, c_void_p) for function in python))
    library.guard_expect_exit()
    return library


@cache
def _load_locked() -> ctypes.PyDLL:
    """The library for calls that keep the interpreter's lock, which take less time."""
    load_library()
    library = ctypes.PyDLL(str(find_compiled("loop")))
    library.guard_enter.argtypes, library.guard_enter.restype = (c_void_p,), c_void_p
    return library


class NamedCall:
    """If the process ends within, its last words name this place; threads have places of their own.

    A function with contextlib takes 3 us more.
    """

    __slots__ = ("_before", "_library", "_place", "_process")

    def __init__(self, place: str | Place) -> None:
        self._library, self._process = _load_locked(), os.getpid()
        self._place = place if isinstance(place, Place) else Place(place.encode())

    def __enter__(self) -> None:
        self._before = self._library.guard_enter(ctypes.addressof(self._place))

    def __exit__(self, *_: object) -> None:
        if os.getpid() != self._process:  # it would go on with the run, and write into the same files
            name = (self._place.text or b"an FMU in a step").decode()
            text = f"{name}: a copy of the process, made by fork(), came back from the call, and was ended\n"
            os.write(2, text.encode())
            os._exit(1)
        self._library.guard_enter(self._before)


@contextmanager
def restore_after_loading(name: str) -> Iterator[None]:
    """The library of the FMU ``name`` is loaded within: how this thread computes with numbers is put back."""
    try:
        yield
    finally:
        changed = int(load_library().guard_restore())
    if changed & CONTROL_WORD:
        log.warning("%s: loading the library changed %s, which was put back", name, _CHANGED_WORD)


@contextmanager
def keep_rows(keep: Callable[[], None]) -> Iterator[None]:
    """If an FMU ends the process within, ``keep`` is called before, in another thread, to store the rows of a run."""
    _watch(os.getpid())
    if "netCDF4" in sys.modules:
        _expect_exit_of_hdf5()
    entry = threading.get_ident(), keep
    _keepers.append(entry)
    try:
        yield
    finally:
        _keepers.remove(entry)


@cache
def _expect_exit_of_hdf5() -> None:
    load_library().guard_expect_exit()


@cache
def _watch(_process: int) -> None:
    """Start the thread that stores rows; one for each process, for a copy by fork() has none."""
    library = load_library()
    reading, writing = os.pipe()

    def wait() -> None:
        thread = int.from_bytes(os.read(reading, _NUMBER_BYTES), sys.byteorder)
        every = list(_keepers)
        for _, keep in [entry for entry in every if entry[0] == thread] or every:
            with suppress(BaseException):  # the process ends, whatever comes
                keep()
        library.guard_note_kept()

    threading.Thread(target=wait, name="keeper of rows", daemon=True).start()
    library.guard_set_keeper(c_int(writing))


class NumberGuard:
    """How this thread computes with numbers, which no FMU may change: compared with what it was, and put back."""

    def __init__(self) -> None:
        self._warned = False

    @contextmanager
    def watch(self, time: float) -> Iterator[None]:
        """Some steps from ``time`` on [s].  Another rounding is an error, for results after it cannot be trusted.

        Raises :class:`CosimError`.
        """
        with NamedCall(f"an FMU in the steps from t = {time:.9g} s on"):
            yield
        found = int(load_library().guard_restore())
        if found & CONTROL_WORD and not self._warned:
            log.warning("an FMU changed %s of this process, which was put back; %s", _CHANGED_WORD, _ADVICE)
            self._warned = True
        if found & ROUNDING:
            raise CosimError(f"an FMU changed the rounding of numbers in this process in the last steps; {_ADVICE}")


class NamedSteps:
    """The place of a thread that runs steps in C.

    Parameters
    ----------
    calls: what the last words call each operation, and how much later than the step it is [s]
    following, row: addresses of the numbers that count operations and rows
    """

    def __init__(self, calls: list[tuple[str, float]], following: int, row: int) -> None:
        self._calls = (NamedStep * len(calls))(*[NamedStep(name.encode(), offset) for name, offset in calls])
        self.place = Place(None, self._calls, following, row)

    def at(self, times: int) -> NamedCall:
        """Steps at these times, by the address of the first [s]."""
        self.place.times = times
        return NamedCall(self.place)


# ---- Ctrl-C ---------------------------------------------------------------------------------------------------------


@contextmanager
def note_interrupts() -> Iterator[c_int]:
    """A number that is zero until SIGINT arrives; the loop in C can read it, too.

    A second SIGINT acts at once, by the handler from before, for an FMU in Python, or in a process of its own, that
    hangs.  Nothing is changed outside of the main thread, where Python takes no signals, and where SIGINT is ignored.
    """
    noted = c_int()
    previous = signal.getsignal(signal.SIGINT)
    main = threading.current_thread() is threading.main_thread()
    if not main or previous in (None, signal.SIG_IGN):
        yield noted
        return

    def note(number: int, frame: FrameType | None) -> None:
        if noted:
            signal.signal(signal.SIGINT, previous)
            if callable(previous):
                previous(number, frame)
        noted.value = number

    signal.signal(signal.SIGINT, note)
    try:
        yield noted
    finally:
        signal.signal(signal.SIGINT, previous)
