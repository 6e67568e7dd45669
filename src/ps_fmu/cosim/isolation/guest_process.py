"""The process that an isolated FMU lives in, as its master has it: started, asked how it fares, ended."""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from ctypes import POINTER, Structure, byref, c_char, c_char_p, c_double, c_int32, c_int64, c_uint32, c_uint64, c_void_p
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from fmpy import platform

from ...terminal import escape_controls
from ..errors import CosimError, UsageError
from .program import ISOLATION

DATA_BYTES = 16 << 20
"""Memory for the values of one exchange; only what is used takes space."""
SPIN_NS = 50_000
"""So long do both sides look at the memory before they sleep [ns], as long as that is not in vain (waiting.h).

A step of two FMUs takes 4.3 to 5.7 us so on two free processors of a virtual machine, and 35 to 50 us where both sides
sleep at once: a halted processor wakes slowly. With more to do than processors it takes 20 to 120 us either way.
"""
ENDING_S = 2.0
"""So long may a process take to end by itself [s]."""
KEPT_LINES = 8
LINE_BYTES = 1000

# Kinds of operations, in the order of channel.h.
_KINDS = """
Instantiate FreeInstance SetDebugLogging SetupExperiment EnterInitializationMode ExitInitializationMode Terminate
Reset SetReal SetInteger SetBoolean SetString GetReal GetInteger GetBoolean GetString DoStep CancelStep GetFMUstate
SetFMUstate FreeFMUstate SerializedFMUstateSize SerializeFMUstate DeSerializeFMUstate GetDirectionalDerivative
SetRealInputDerivatives GetRealOutputDerivatives GetStatus GetRealStatus GetIntegerStatus GetBooleanStatus
GetStringStatus
"""
FUNCTIONS = tuple(f"fmi2{name}" for name in _KINDS.split())
ALIVE, KILLED, EXITED, HANGS, INTERRUPTED = range(5)  # Fate of client.h
CHANGES = {
    1: "changed the rounding of floating-point numbers, so that its results are not those of any other tool",
    2: "closed file descriptors that belong to its host",
}
"""What an FMU may not do, by Change of channel.h."""


class _Client(Structure):
    """The beginning of ``Client`` of client.h."""

    _fields_ = (
        ("channel", c_void_p),
        ("library", c_char_p),
        ("data_bytes", c_uint64),
        ("guest", c_int64),
        ("spin_ns", c_int64),
        ("step_ns", c_int64),
        ("life_ns", c_int64),
        ("interrupts", c_void_p),
        ("fate", c_int64),
        ("fate_number", c_int64),
    )


class _Outcome(Structure):
    """``Outcome`` of client.c."""

    _fields_ = (
        ("kind", c_int32),
        ("status", c_int32),
        ("count", c_uint64),
        ("references", POINTER(c_uint32)),
        ("time", c_double),
    )


@dataclass(frozen=True)
class Outcome:
    """A call of the last exchange.  ``status`` is -1 if it was not made; ``time`` [s] is that of an fmi2DoStep."""

    function: str
    status: int
    references: tuple[int, ...]
    time: float | None


def find_library() -> Path:
    """The compiled library.

    Raises :class:`UsageError` where there is none for this platform, :class:`CosimError` if it is damaged or missing.
    """
    try:
        path = ISOLATION.find_whole(platform)
    except OSError as error:
        raise CosimError(f"isolation: {error}") from error
    if path is None or not hasattr(os, "memfd_create"):
        raise UsageError(f"isolation: FMUs can have processes of their own on 64-bit Linux only, this is {platform}")
    return path


@cache
def load_library() -> ctypes.CDLL:
    """The functions of client.c and later.c that are not of FMI.  Raises as :func:`find_library`."""
    library = ctypes.CDLL(str(find_library()))
    for function in (library.channel_bytes, library.client_bytes):
        function.argtypes, function.restype = (), c_uint64
    for function in (library.set_next_client, library.end_isolated, library.interrupt_isolated, library.clear_client):
        function.argtypes, function.restype = (c_void_p,), None
    for function in (library.get_last_begun, library.get_change):
        function.argtypes, function.restype = (c_void_p,), c_uint32
    library.get_outcome.argtypes = (c_void_p, c_uint32, POINTER(_Outcome))
    return library


class GuestProcess:
    """A process for one FMU, with the memory that it shares with this one.

    Parameters
    ----------
    library: of the FMU
    timeouts_s: how long a call of a step may take, and any other [s]
    show: takes each line that the process writes to its standard output or error
    interrupts: address of an int; waiting ends when it is above 1
    """

    def __init__(
        self, library: Path, timeouts_s: tuple[float, float], show: Callable[[str], None], interrupts: int | None = None
    ) -> None:
        functions = load_library()
        size = functions.channel_bytes() + DATA_BYTES
        descriptor = os.memfd_create("ps_fmu")  # has no name in the file system: nothing is left behind
        try:
            os.ftruncate(descriptor, size)
            self._memory = mmap.mmap(descriptor, size)
            self._process = _start(descriptor, size)
        finally:
            os.close(descriptor)
        self._space = ctypes.create_string_buffer(functions.client_bytes())
        self.address = ctypes.addressof(self._space)
        self._client = _Client.from_buffer(self._space)
        client = self._client
        client.channel = ctypes.addressof(c_char.from_buffer(self._memory))
        client.library, client.data_bytes = os.fsencode(library), DATA_BYTES
        client.guest, client.spin_ns = self._process.pid, SPIN_NS
        client.step_ns, client.life_ns = (int(1e9 * s) for s in timeouts_s)
        client.interrupts = interrupts
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)
        """The last that the process wrote."""
        self._reader = threading.Thread(target=self._read, args=(show,), daemon=True, name="output of an FMU")
        self._reader.start()

    @property
    def fate(self) -> int:
        """ALIVE, or how the process came to its end."""
        return int(self._client.fate)

    def describe_end(self) -> str:
        """What happened to the process, as the predicate of a sentence about the call that it was in."""
        number = int(self._client.fate_number)
        if self.fate == KILLED:
            return f"crashed: its process was killed by {_name_signal(number)}"
        if self.fate == EXITED:
            return f"did not return: its process ended with exit code {number}, as by exit({number})"
        return "did not return"

    @property
    def change(self) -> str | None:
        """What the FMU did to its process and may not do, as a predicate."""
        return CHANGES.get(load_library().get_change(self.address))

    def list_outcomes(self) -> list[Outcome]:
        """The calls of the last exchange."""
        found: list[Outcome] = []
        outcome = _Outcome()
        while load_library().get_outcome(self.address, len(found), byref(outcome)):
            function = FUNCTIONS[outcome.kind]
            named = function.removeprefix("fmi2")[3:] in ("Real", "Integer", "Boolean", "String")
            references = tuple(outcome.references[: outcome.count]) if named else ()
            time = outcome.time if function == "fmi2DoStep" else None
            found.append(Outcome(function, outcome.status, references, time))
        return found

    def find_last_begun(self) -> int:
        """Place among the outcomes of the call that ended the process, or during which it was ended."""
        return int(load_library().get_last_begun(self.address))

    def interrupt(self) -> None:
        """End the process: the master does not wait for it any longer."""
        load_library().interrupt_isolated(self.address)

    def join_output(self) -> None:
        """Wait for the last lines of a process that has ended."""
        self._reader.join(timeout=0.5)

    def close(self) -> None:
        """End the process if it has not ended; no zombie stays."""
        functions = load_library()
        functions.end_isolated(self.address)
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=ENDING_S if self.fate == ALIVE else 0.0)
        _end_group(self._process.pid)  # also what the FMU has started
        self._process.wait()
        self._reader.join(timeout=ENDING_S)
        functions.clear_client(self.address)

    def _read(self, show: Callable[[str], None]) -> None:
        pipe = self._process.stdout
        assert pipe is not None
        with pipe:
            for raw in _iterate_lines(pipe):
                text = escape_controls(raw.decode(errors="replace").rstrip())
                if text:
                    self.lines.append(text)
                    show(text)


def _iterate_lines(pipe: object) -> Iterator[bytes]:
    return iter(lambda: pipe.readline(LINE_BYTES), b"")  # type: ignore[attr-defined]


def _start(descriptor: int, size: int) -> subprocess.Popen[bytes]:
    """In a session of its own: Ctrl-C of the terminal does not reach it, and it can be ended with its children."""
    script = str(Path(__file__).with_name("guest.py"))
    numbers = map(str, (descriptor, size, os.getpid(), SPIN_NS))
    return subprocess.Popen(
        [sys.executable, "-I", "-B", script, str(find_library()), *numbers],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, pass_fds=(descriptor,),
        start_new_session=True,
    )  # fmt: skip


def _end_group(process: int) -> None:
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process, signal.SIGKILL)


def _name_signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
