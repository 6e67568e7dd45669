"""The compiled library of this package, for C functions that let go of Python's lock.

Its sources are in ``native/numerics``; ``make launcher`` compiles them.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from ctypes import CFUNCTYPE, POINTER, Structure, c_char_p, c_double, c_int64, c_uint32, c_void_p
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ..native import NotCompiledError, load

PART = 64
"""Angles that ``add_turning`` and ``add_wheel`` work on together: their room is (multiples and products, 2, PART)."""


class Tables(Structure):
    """``Tables`` of numerics.h."""

    _fields_ = (
        ("one", c_void_p), ("other", c_void_p), ("n", c_int64), ("shift_one", c_int64), ("shift_other", c_int64),
        ("start", c_double), ("rate", c_double),
    )  # fmt: skip


class Run(Structure):
    """``Run`` of numerics.h."""

    _fields_ = (("first", c_int64), ("end", c_int64), ("bin", c_int64), ("mirrored", c_int64))


class Lines(Structure):
    """``Lines`` of numerics.h."""

    _fields_ = (
        ("share", c_void_p), ("gains", c_void_p), ("turns", c_void_p), ("roots", c_void_p), ("runs", POINTER(Run)),
        ("n", c_int64), ("n_terms", c_int64), ("phases", c_int64), ("points", c_int64), ("n_runs", c_int64),
    )  # fmt: skip


class Product(Structure):
    """``Product`` of numerics.h."""

    _fields_ = (("one", c_int64), ("other", c_int64), ("conjugate", c_int64))


class Turning(Structure):
    """``Turning`` of numerics.h."""

    _fields_ = (
        ("multiples", c_void_p), ("products", POINTER(Product)), ("which", POINTER(c_int64)), ("amplitudes", c_void_p),
        *((name, c_int64) for name in ("n_multiples", "n_products", "n_force", "n_lines")),
        ("along", c_double * 6 * 4),
    )  # fmt: skip


class Profile(Structure):
    """``Profile`` of numerics.h."""

    _fields_ = tuple((name, c_double) for name in ("initial", "final", "start", "duration", "rise_time"))


class Errors(Structure):
    """``Errors`` of numerics.h."""

    _fields_ = (
        ("deviation", c_double),
        *((name, c_int64) for name in ("sensors", "samples", "stride", "places")),
        ("words", c_uint32 * 4),
    )


class Bridge(Structure):
    """``Bridge`` of numerics.h."""

    _fields_ = (
        *((name, c_void_p) for name in ("decay", "kick", "weight")),
        *((name, c_int64) for name in ("steps", "processes", "sensors")),
    )


LANES = 8
"""Rows of a matrix that a map takes together."""


class Discretisation(Structure):
    """``Discretisation`` of expm.h."""

    _fields_ = (
        *((name, c_int64) for name in ("n", "m", "stride")), ("step", c_double),
        *((name, c_void_p) for name in ("A", "B", "exponential", "held", "ramp", "room")),
        *((name, c_int64) for name in ("stage", "column", "halvings", "doublings", "sweeps")), ("largest", c_double),
    )  # fmt: skip


class Room(Structure):
    """``BlockRoom`` of ``native/numerics/expm.h``: where ``make_blocks`` puts what it makes.

    Its arrays, for matrices of n columns and ``groups`` groups of rows, live as long as it.
    """

    _fields_ = (
        ("blocks", c_void_p), ("columns", c_void_p), ("numbers", c_void_p), ("costs", c_void_p), ("words", c_void_p)
    )  # fmt: skip

    def __init__(self, n: int, groups: int) -> None:
        self.arrays = (
            np.zeros((groups, 5), np.int64), np.zeros(groups * n, np.int32), allocate(groups * n * LANES),
            np.zeros(groups + 1), np.zeros((groups + 1) * (n // 64 + 2), np.int64),
        )  # fmt: skip
        super().__init__(*(array.ctypes.data for array in self.arrays))


class MapWords(Structure):
    """The structure ``Map`` in ``native/kernel/core.h``."""

    _fields_ = (
        ("source", c_void_p), ("target", c_void_p), ("work", c_void_p), ("n_target", c_int64), ("n_blocks", c_int64),
        ("blocks", c_void_p), ("columns", c_void_p), ("numbers", c_void_p),
    )  # fmt: skip


class Arithmetic(Structure):
    """``Arithmetic`` of numerics.h: the functions, by name.  Each look-up makes a new object: keep it."""

    _fields_ = (
        ("instructions", c_char_p),
        ("add_rows", CFUNCTYPE(None, POINTER(Tables), c_void_p, c_int64, c_void_p)),
        (
            "draw_lines",
            CFUNCTYPE(None, POINTER(Lines), c_void_p, c_void_p, c_int64, c_double, c_void_p, c_int64, c_int64),
        ),
        ("add_turning", CFUNCTYPE(None, POINTER(Turning), c_void_p, c_int64, c_void_p, c_int64, c_void_p, c_void_p)),
        ("draw_keyed", CFUNCTYPE(None, c_void_p, c_int64, c_int64, c_int64, c_void_p)),
        ("connect", CFUNCTYPE(None, POINTER(Bridge), c_void_p, c_void_p, c_void_p, c_void_p)),
        *(
            (name, c_void_p)  # for calls.py
            for name in (
                "clear_rows", "draw_numbers", "draw_some_lines", "store_phase", "add_some_rows", "add_some_turns",
                "draw_some_keyed", "make_some_errors",
            )
        ),
    )  # fmt: skip


@cache
def find_library() -> ctypes.CDLL:
    """The library.  Raises NotCompiledError."""
    library = load("numerics")
    library.numerics_find.argtypes, library.numerics_find.restype = (c_char_p,), POINTER(Arithmetic)
    library.discretise_room.argtypes, library.discretise_room.restype = (c_int64,), c_int64
    library.discretise.argtypes, library.discretise.restype = (POINTER(Discretisation), c_int64), c_int64
    library.make_blocks.argtypes = (c_void_p, c_int64, c_int64, c_void_p, c_void_p)
    library.make_blocks.restype = c_int64
    return library


with suppress(NotCompiledError):  # whoever needs it is told; an FMU's folder goes with its first instance
    find_library()


@cache
def find_arithmetic() -> Arithmetic:
    """The functions by the instructions that this processor does best.  Raises NotCompiledError."""
    found: Arithmetic = find_library().numerics_find(b"").contents
    return found


def allocate(n: int) -> NDArray[np.float64]:
    """Zeros that start on a cache line, (n,)."""
    raw = np.zeros(n + 8)
    first = -find_address(raw) % 64 // 8
    return raw[first : first + n]


def find_address(array: NDArray[np.float64] | NDArray[np.complex128]) -> int:
    """Where the numbers of an array are, doubles that lie side by side.  Raises ValueError for others."""
    if array.dtype.char not in "dD" or not array.flags.c_contiguous:
        raise ValueError(f"{array.dtype} with strides {array.strides}: expected doubles without gaps")
    return int(array.__array_interface__["data"][0])
