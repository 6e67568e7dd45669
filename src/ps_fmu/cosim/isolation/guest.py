"""The process of one isolated FMU: carries out the calls of the pipe here, and those of steps in C (``guest.c``).

It is run as a file, ``python -I guest.py LIBRARY PIPE MEMORY BYTES MASTER SPIN``, so that it imports little, and
nothing else of the package: 30 ms instead of 300.  LIBRARY is ``isolation`` of
``ps_fmu.native``, PIPE and MEMORY are descriptors.

A call in the pipe is the name of a function of FMI and its arguments without the instance, see :func:`pack`; the answer
has what the call has left in each of them, None for a number.
"""

from __future__ import annotations

import binascii
import ctypes
import json
import mmap
import os
import sys
from ctypes import Array, c_char, c_char_p, c_double, c_int, c_int64, c_size_t, c_ssize_t, c_uint, c_void_p

TYPE_CHECKING = False
if TYPE_CHECKING:  # typing would take 10 ms to import
    from typing import Any


OK, ERROR = 0, 3
_IN_STEPS = "SetReal SetInteger SetBoolean GetReal GetInteger GetBoolean SetRealInputDerivatives DoStep"
STEP_FUNCTIONS = tuple(f"fmi2{name}" for name in _IN_STEPS.split())
"""Functions of the steps, in the order of ``Kind`` of channel.h."""
_NEEDED = ("fmi2Instantiate", "fmi2FreeInstance", "fmi2DoStep")
_CO_SIMULATION = 1  # fmi2Type
_TYPES: dict[str, Any] = {kind._type_: kind for kind in (c_double, c_uint, c_int, c_char, c_char_p, c_void_p, c_size_t)}


def encode(content: Any) -> bytes:
    """A line of JSON for lists, numbers, texts and bytes."""
    text = json.dumps(content, default=lambda raw: {"base64": binascii.b2a_base64(raw, newline=False).decode()})
    return text.encode() + b"\n"


def decode(line: bytes) -> Any:
    """What :func:`encode` was given.  Raises EOFError if the line is not complete."""
    if not line.endswith(b"\n"):
        raise EOFError
    return json.loads(line, object_hook=lambda found: binascii.a2b_base64(found["base64"]))


def pack(argument: Any) -> Any:
    """An argument of a function of C for the pipe: a number or a text, an array, or ``byref`` of a number.

    Of the last two it is the type of C, the length of an array, and the content.
    """
    if isinstance(argument, int | float | bytes):
        return argument
    value = find_memory(argument)
    if isinstance(value, Array):
        return [value._type_._type_, len(value), read(value)]
    return (argument.value or 0) if value is argument else [value._type_, None, read(value)]


def find_memory(argument: Any) -> Any:
    """The array or number of ctypes behind an argument."""
    return getattr(argument, "_obj", argument)


def read(value: Any) -> Any:
    """The content of an array or number: texts, or bytes."""
    return [*value] if isinstance(value, Array) and value._type_ is c_char_p else bytes(value)


def write(value: Any, content: Any) -> None:
    """Put the content of :func:`read` into an array or number."""
    if isinstance(content, list):
        value[:] = content
    else:
        ctypes.memmove(ctypes.addressof(value), content, len(content))


def _unpack(packed: Any) -> tuple[Any, Any]:
    """What a function gets, and the memory behind it, or None."""
    if isinstance(packed, list):
        kind, length, content = packed
        value = _TYPES[kind]() if length is None else (_TYPES[kind] * length)()
        write(value, content)
        return (ctypes.byref(value) if length is None else value), value
    if isinstance(packed, bytes):
        return c_char_p(packed), None
    return (c_double if isinstance(packed, float) else c_ssize_t)(packed), None  # as wide as any integer


class Guest:
    """The FMU of this process; ``library`` has guest.c."""

    def __init__(self, library: ctypes.CDLL) -> None:
        self._library = library
        self._fmu: ctypes.CDLL | None = None
        self._instance = c_void_p()

    def call(self, function: str, arguments: list[Any]) -> tuple[int, list[Any]]:
        """The status of a call, and what it has left in its arguments."""
        if function == "fmi2Instantiate":
            return self._instantiate(*arguments), []
        called = getattr(self._fmu, function, None)
        if called is None:
            return self._refuse("the library has no such function"), []
        called.restype = None if function == "fmi2FreeInstance" else c_int
        unpacked = [_unpack(argument) for argument in arguments]
        status = called(self._instance, *(given for given, _ in unpacked))
        return status or OK, [None if value is None else read(value) for _, value in unpacked]

    def _instantiate(self, path: Any, name: Any, guid: Any, location: Any) -> int:
        try:
            self._fmu = self._fmu or ctypes.CDLL(os.fsdecode(path))
        except OSError as error:
            return self._refuse(str(error))
        finally:
            self._library.check_control_word()
        if not all(hasattr(self._fmu, function) for function in _NEEDED):
            return self._refuse("the library lacks functions of FMI 2.0 for co-simulation")
        make = self._fmu.fmi2Instantiate
        make.restype = c_void_p
        callbacks = c_void_p(self._library.get_callbacks())
        self._instance = c_void_p(make(name, _CO_SIMULATION, guid, location, callbacks, 0, 1))
        found = [getattr(self._fmu, function, 0) for function in STEP_FUNCTIONS]
        addresses = [ctypes.cast(one, c_void_p).value for one in found]
        self._library.set_instance(self._instance, (c_void_p * len(addresses))(*addresses))
        return OK if self._instance else ERROR

    def _refuse(self, why: str) -> int:
        self._library.note_error(why.encode())
        return ERROR


def serve(library: str, pipe: int, descriptor: int, size: int, master: int, spin_ns: int) -> None:
    """Carry out what the process ``master`` asks for until it closes the pipe; never returns."""
    memory = mmap.mmap(descriptor, size)
    os.close(descriptor)
    os.set_inheritable(pipe, False)
    functions = ctypes.CDLL(library)
    functions.get_callbacks.restype = c_void_p
    functions.begin_guest(c_void_p(ctypes.addressof(c_char.from_buffer(memory))), master)
    guest, requests, answers = Guest(functions), os.fdopen(pipe, "rb"), os.fdopen(os.dup(pipe), "wb")
    while True:
        functions.serve_steps(c_int64(spin_ns))
        try:
            function, arguments = decode(requests.readline())
        except EOFError:
            os._exit(0)  # no destructors: some libraries crash in theirs, and nobody needs their memory back
        status, contents = guest.call(function, arguments)
        functions.finish_call(status)
        answers.write(encode(contents))
        answers.flush()


if __name__ == "__main__":
    serve(sys.argv[1], *map(int, sys.argv[2:]))
