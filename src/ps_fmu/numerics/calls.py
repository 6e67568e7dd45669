"""Compiled work that waits: calls that a host's launcher makes later, one by one, without Python.

A model's generator of rows yields :class:`Calls` where it would otherwise yield after each part.  Who steps the model
makes as many of them as there is time for, here or in C.  When the generator goes on, it makes those that are left.
"""

from __future__ import annotations

import ctypes
from array import array
from collections.abc import Generator, Iterator, Sequence
from ctypes import CFUNCTYPE, POINTER, Structure, c_double, c_int64, c_uint32, c_void_p
from typing import Any, TypeVar

from . import library

Pair = tuple[int, Structure]
"""A function of the library that takes one structure, and that structure."""

_FUNCTION = CFUNCTYPE(None, c_void_p)
T = TypeVar("T")


class NoiseBlock(Structure):
    """``NoiseBlock`` of numerics.h."""

    _fields_ = (
        ("lines", POINTER(library.Lines)),
        *((name, c_void_p) for name in ("factor", "draws", "terms", "room", "sizes", "rows")),
        ("words", POINTER(c_uint32)), ("n_words", c_int64), ("sources", c_int64), ("power", c_double),
    )  # fmt: skip


class Part(Structure):
    """``Part`` of numerics.h."""

    _fields_ = (("block", POINTER(NoiseBlock)), ("first", c_int64), ("end", c_int64))


class Progress(Structure):
    """``Progress`` of numerics.h: what is left of the rows that calls of one function make in turn."""

    _fields_ = (("rows", c_void_p), ("n", c_int64), ("at_once", c_int64))


class TableRows(Structure):
    """``TableRows`` of numerics.h."""

    _fields_ = (("left", Progress), ("tables", POINTER(library.Tables)), ("time", c_void_p), ("clear", c_int64))


class WheelRows(Structure):
    """``WheelRows`` of numerics.h."""

    _fields_ = (
        ("left", Progress), ("turning", POINTER(library.Turning)), ("profile", POINTER(library.Profile)),
        ("time", c_void_p), ("room", c_void_p),
    )  # fmt: skip


class KeyedRows(Structure):
    """``KeyedRows`` of numerics.h."""

    _fields_ = (("left", Progress), ("words", POINTER(c_uint32)), ("n_words", c_int64), ("half", c_int64))


class ErrorKind(Structure):
    """``ErrorKind`` of numerics.h."""

    _fields_ = (
        ("errors", POINTER(library.Errors)), ("drift", c_void_p), ("first_drift", c_int64), ("column", c_int64)
    )  # fmt: skip


class ErrorRoom(Structure):
    """``ErrorRoom`` of numerics.h."""

    _fields_ = (("rows", c_void_p), ("first", c_int64), ("n", c_int64))


class ErrorRows(Structure):
    """``ErrorRows`` of numerics.h."""

    _fields_ = (
        ("left", Progress), ("room", POINTER(ErrorRoom)), ("kinds", POINTER(ErrorKind)),
        *((name, c_void_p) for name in ("index", "bias", "gain")),
        *((name, c_int64) for name in ("n_kinds", "samples", "width")),
    )  # fmt: skip


class _Words(Structure):
    """``Calls`` of the launcher."""

    _fields_ = (("calls", c_void_p), ("n", c_int64), ("next", c_int64), ("later", c_int64))

    n: int
    next: int
    later: int


class CallList:
    """Calls that are made time and again.  The structures are its own.

    Attributes
    ----------
    words: of each call, the addresses of the function and of its structure: ``Call`` of the launcher.
    """

    def __init__(self, pairs: Sequence[Pair]) -> None:
        self._pairs = pairs
        # Not a ctypes array: the first one of each length makes a type, which takes 50 us.
        self.words = array("Q", [word for function, given in pairs for word in (function, ctypes.addressof(given))])

    def __len__(self) -> int:
        return len(self._pairs)


class Calls:
    """Calls to be made in their order, each once; who makes one counts it in the words.

    Parameters
    ----------
    pairs: the calls; one that occurs several times makes so many parts of the rows.  Or a :class:`CallList` of them.
    kept: what the structures point to; it lives as long.
    first: those before it are left out.
    """

    def __init__(self, pairs: Sequence[Pair] | CallList, *kept: object, first: int = 0) -> None:
        calls = pairs if isinstance(pairs, CallList) else CallList(pairs)
        self._calls, self._kept = calls.words, (calls, kept)
        self._words = _Words(calls.words.buffer_info()[0], len(calls), first, 1)

    @property
    def address(self) -> int:
        """Of the words, for the launcher."""
        return ctypes.addressof(self._words)

    @property
    def left(self) -> int:
        """Calls that were not made yet."""
        return self._words.n - self._words.next

    @property
    def later(self) -> int:
        """Parts of the work that come after all calls, at least 1."""
        return self._words.later

    def put_before(self, parts: int) -> Calls:
        """Note that more parts come after these calls; returns these."""
        self._words.later += parts
        return self

    def make_next(self) -> None:
        """Make the next call, without Python's lock."""
        place = 2 * self._words.next
        self._words.next += 1
        _FUNCTION(self._calls[place])(self._calls[place + 1])

    def finish(self) -> None:
        """Make all that are left."""
        while self.left:
            self.make_next()

    def __iter__(self) -> Iterator[Calls]:
        """Yield these calls to whoever may make some of them; then make the others."""
        if self.left:
            yield self
        self.finish()


def put_before(part: int | Calls, parts: int) -> int | Calls:
    """What a generator yields, if so many parts more come after its own."""
    return part.put_before(parts) if isinstance(part, Calls) else part + parts


def finish(parts: Generator[Any, None, T]) -> T:
    """What the parts make, all at once."""
    while True:
        try:
            next(parts)
        except StopIteration as end:
            made: T = end.value
            return made


def count(parts: Generator[Any, None, T], left: int) -> Generator[int, None, T]:
    """The same parts; the first says that ``left`` are still to come, and each other one less, but at least one."""
    while True:
        try:
            next(parts)
        except StopIteration as end:
            made: T = end.value
            return made
        yield max(left, 1)
        left -= 1
