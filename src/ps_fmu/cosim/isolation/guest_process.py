"""The process that an isolated FMU lives in, as its master has it: started, asked how it fares, ended."""

from __future__ import annotations

import ctypes
import mmap
import os
import signal
import socket
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import suppress
from ctypes import (
    POINTER,
    Structure,
    c_char,
    c_char_p,
    c_double,
    c_int,
    c_int32,
    c_int64,
    c_uint32,
    c_uint64,
    c_void_p,
)
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from fmpy.fmi2 import fmi2CallbackFunctions

from ...child_processes import end_group
from ...native import find_compiled, find_platform
from ...terminal import escape_controls
from ..errors import CosimError, UsageError
from .guest import STEP_FUNCTIONS, decode, encode, find_memory, pack, write

DATA_BYTES = 16 << 20
"""Memory for the values of one step; only what is used takes space."""
SPIN_NS = 50_000
"""So long do both sides look at the memory before they sleep [ns], as long as that is not in vain (waiting.h).

A step of two FMUs takes 4.3 to 5.7 us so on two free processors of a virtual machine, and 35 to 50 us where both sides
sleep at once: a halted processor wakes slowly. With more to do than processors it takes 20 to 120 us either way.
"""
ENDING_S = 2.0
"""So long may a process take to end by itself [s]."""
_ROOM_BYTES = 1 << 16  # so much goes into the pipe before somebody reads it
KEPT_LINES = 8
LINE_BYTES = 1000

_WARNING, _FATAL = 1, 4  # fmi2Status
ALIVE, KILLED, EXITED, HANGS, INTERRUPTED = range(5)  # Fate of client.h
_OF_PYTHON = "PyGILState_Ensure", "PyGILState_Release", "PyErr_CheckSignals", "PyErr_Clear"  # Python of client.h
CHANGES = {
    1: "changed the rounding of floating-point numbers, which changes its results",
    2: "closed file descriptors that belong to its host",
}
"""What an FMU may not do, by Change of channel.h."""


class _Client(Structure):
    """The beginning of ``Client`` of client.h."""

    _fields_ = (
        ("channel", c_void_p),
        ("data_bytes", c_uint64),
        ("guest", c_int64),
        ("spin_ns", c_int64),
        ("step_ns", c_int64),
        ("python", c_void_p * 4),
        ("callbacks", c_void_p),
        ("name", c_char_p),
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
    platform = find_platform()
    if platform != "linux64" or not hasattr(os, "memfd_create"):
        raise UsageError(f"isolation: FMUs can have processes of their own on 64-bit Linux only, this is {platform}")
    try:
        return find_compiled("isolation")
    except OSError as error:
        raise CosimError(f"isolation: {error}") from error


@cache
def load_library() -> ctypes.CDLL:
    """The functions of client.c and later.c.  Raises as :func:`find_library`."""
    library = ctypes.CDLL(str(find_library()))
    for function in (library.channel_bytes, library.client_bytes):
        function.argtypes, function.restype = (), c_uint64
    for function in (library.begin_call, library.forget_reads):
        function.argtypes, function.restype = (c_void_p,), None
    library.flush_batch.argtypes, library.collect_batch.argtypes = (c_void_p,), (c_void_p, c_int64)
    library.end_guest.argtypes, library.end_guest.restype = (c_void_p, c_int), None
    for function in (library.get_last_begun, library.get_change):
        function.argtypes, function.restype = (c_void_p,), c_uint32
    library.get_outcome.argtypes = (c_void_p, c_uint32, POINTER(_Outcome))
    return library


class GuestProcess:
    """A process for one FMU, with the memory that it shares with this one.

    Parameters
    ----------
    timeouts_s: how long a call of a step may take, and any other [s]
    show: takes each line that the process writes to its standard output or error
    """

    def __init__(self, timeouts_s: tuple[float, float], show: Callable[[str], None]) -> None:
        functions = load_library()
        size = functions.channel_bytes() + DATA_BYTES
        self._pipe, theirs = socket.socketpair()
        descriptor = os.memfd_create("ps_fmu")  # has no name in the file system: nothing is left behind
        try:
            os.ftruncate(descriptor, size)
            self._memory = mmap.mmap(descriptor, size)
            self._process = _start(theirs.fileno(), descriptor, size)
        except BaseException:
            self._pipe.close()
            raise
        finally:
            os.close(descriptor)
            theirs.close()
        self._timeouts_s, self._function = timeouts_s, ""
        self._answers = self._pipe.makefile("rb")
        self._space = ctypes.create_string_buffer(functions.client_bytes())
        self.address = ctypes.addressof(self._space)
        self._client = _Client.from_buffer(self._space)
        client = self._client
        client.channel = ctypes.addressof(c_char.from_buffer(self._memory))
        client.data_bytes, client.guest, client.spin_ns = DATA_BYTES, self._process.pid, SPIN_NS
        client.step_ns = int(1e9 * timeouts_s[0])
        client.python[:] = [ctypes.cast(getattr(ctypes.pythonapi, name), c_void_p).value for name in _OF_PYTHON]
        self.lines: deque[str] = deque(maxlen=KEPT_LINES)
        """The last that the process wrote."""
        self._reader = threading.Thread(target=self._read, args=(show,), daemon=True, name="output of an FMU")
        self._reader.start()

    def listen(self, name: str, callbacks: fmi2CallbackFunctions) -> None:
        """Pass messages of the FMU on to these callbacks, which live as long as this object."""
        self._client.name, self._client.callbacks = name.encode(), ctypes.addressof(callbacks)

    def find_limit(self, function: str) -> float:
        """How long a call of a function may take [s]."""
        return self._timeouts_s[function not in STEP_FUNCTIONS]

    def flush(self) -> int:
        """Carry out what steps have put off; the status of that."""
        return int(load_library().flush_batch(self.address))

    def call(self, function: str, *arguments: Any) -> int:
        """Call a function of FMI by the pipe, all arguments but the instance; the status.

        What it changes in the arguments is changed in these, too.
        """
        if self.fate != ALIVE:
            return _FATAL
        functions, self._function = load_library(), function
        request = encode([function, [pack(argument) for argument in arguments]])
        parts = request[:_ROOM_BYTES], request[_ROOM_BYTES:]
        status = _FATAL
        try:
            with suppress(OSError):  # the process has ended
                self._pipe.sendall(parts[0])
            functions.begin_call(self.address)
            with suppress(OSError):
                self._pipe.sendall(parts[1])
            status = int(functions.collect_batch(self.address, int(1e9 * self.find_limit(function))))
            contents = decode(self._answers.readline()) if self.fate == ALIVE else []
        except KeyboardInterrupt:
            functions.end_guest(self.address, INTERRUPTED)
            return _FATAL
        except (EOFError, OSError):  # the process ends meanwhile, or its FMU has closed the pipe
            return max(status, _FATAL)
        for argument, content in zip(arguments, contents, strict=False):
            if content is not None:
                write(find_memory(argument), content)
        return status

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
        while load_library().get_outcome(self.address, len(found), ctypes.byref(outcome)):
            function = (*STEP_FUNCTIONS, self._function)[outcome.kind]
            named = function.removeprefix("fmi2")[3:] in ("Real", "Integer", "Boolean", "String")
            references = tuple(outcome.references[: outcome.count]) if named else ()
            time = outcome.time if function == "fmi2DoStep" else None
            found.append(Outcome(function, outcome.status, references, time))
        return found

    def find_last_begun(self) -> int:
        """Place among the outcomes of the call that ended the process, or during which it was ended."""
        return int(load_library().get_last_begun(self.address))

    def join_output(self) -> None:
        """Wait for the last lines of a process that has ended."""
        self._reader.join(timeout=0.5)

    def close(self) -> None:
        """End the process if it has not ended; no zombie stays."""
        functions = load_library()
        if self.fate == ALIVE and self.flush() <= _WARNING:
            functions.begin_call(self.address)
        self._answers.close()
        self._pipe.close()  # so it ends
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(timeout=ENDING_S if self.fate == ALIVE else 0.0)
        end_group(self._process.pid)  # also what the FMU has started
        self._process.wait()
        self._reader.join(timeout=ENDING_S)
        functions.forget_reads(self.address)

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


def _start(pipe: int, descriptor: int, size: int) -> subprocess.Popen[bytes]:
    """In a session of its own: Ctrl-C of the terminal does not reach it, and it can be ended with its children."""
    script = str(Path(__file__).with_name("guest.py"))
    numbers = map(str, (pipe, descriptor, size, os.getpid(), SPIN_NS))
    return subprocess.Popen(
        [sys.executable, "-I", "-B", script, str(find_library()), *numbers],
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, pass_fds=(pipe, descriptor),
        start_new_session=True,
    )  # fmt: skip


def _name_signal(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
