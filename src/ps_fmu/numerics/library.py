"""The compiled library of this package, for C functions that let go of Python's lock.

Its sources are in ``native/numerics``; ``make launcher`` compiles them.
"""

from __future__ import annotations

import ctypes
from contextlib import suppress
from ctypes import CFUNCTYPE, POINTER, Structure, c_char_p, c_double, c_int64, c_uint32, c_void_p
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..native import NotCompiledError, load

PART = 64
"""Angles of a wheel that are worked on together: their room is (multiples and products, 2, PART)."""
NONE = -(2**63)
"""The number of no block."""
MOST_TEXT, BLOCKS, PROCESSES, PLACES, GRIDS, WHITE, WHITE_ROWS, SENSORS = 400, 3, 6, 64, 6, 256, 512, 15
"""As in numerics.h."""


def _make_fields(types: str) -> tuple[tuple[str, Any], ...]:
    """Fields of a structure from a text of types and names: ``d`` double, ``i`` whole number, ``p`` address."""
    kinds, fields = {"d": c_double, "i": c_int64, "p": c_void_p}, []
    for part in types.split(";"):
        kind, *names = part.split()
        fields += [(name, kinds[kind]) for name in names]
    return tuple(fields)


class Kept(Structure):
    """A structure with addresses: what lies there lives as long as it."""

    kept: object = None


class Tables(Kept):
    """``Tables`` of numerics.h."""

    _fields_ = _make_fields("p one other; i n shift_one shift_other; d start rate")


class Run(Structure):
    """``Run`` of numerics.h."""

    _fields_ = _make_fields("i first end bin mirrored")


class Lines(Kept):
    """``Lines`` of numerics.h."""

    _fields_ = _make_fields("p share gains turns roots runs; i n n_terms phases points n_runs")


class Product(Structure):
    """``Product`` of numerics.h."""

    _fields_ = _make_fields("i one other conjugate")


class Turning(Structure):
    """``Turning`` of numerics.h."""

    _fields_ = (
        *_make_fields("p multiples products which amplitudes; i n_multiples n_products n_force n_lines"),
        ("along", c_double * 6 * 4),
    )


class Profile(Structure):
    """``Profile`` of numerics.h."""

    _fields_ = _make_fields(
        "d initial final start duration rise_time; p times speeds slopes turned; i n_rows; d turned_before"
    )


class Wheel(Kept):
    """``Wheel`` of numerics.h."""

    _fields_ = (("turning", Turning), ("profile", Profile), ("room", c_void_p))


class Tone(Kept):
    """``Tone`` of numerics.h."""

    _fields_ = (("wrench", c_double * 6), *_make_fields("d frequency phase rise_time"))


class Chirp(Kept):
    """``Chirp`` of numerics.h."""

    _fields_ = (("wrench", c_double * 6), *_make_fields("d initial final start duration rise_time rate"))


class RisingTable(Structure):
    """``RisingTable`` of numerics.h."""

    _fields_ = (("rising", Tables), ("steady", Tables))


class Multisine(Kept):
    """``Multisine`` of numerics.h."""

    _fields_ = _make_fields("p tables; i n_tables; d rise_time")


class Track(Structure):
    """``Track`` of numerics.h."""

    _fields_ = _make_fields("p time wrench; i n")


class Recording(Kept):
    """``Recording`` of numerics.h."""

    _fields_ = (("first", Track), ("steady", Track), *_make_fields("i repeats has_first"))


class NoiseLayer(Structure):
    """``NoiseLayer`` of numerics.h."""

    _fields_ = (
        ("lines", Lines), *_make_fields("p factor windows draws terms room sizes"), ("rows", c_void_p * BLOCKS),
        *_make_fields("p words; i n_words sources; d power rate period rise_time"), ("number", c_int64 * BLOCKS),
        *_make_fields("i making done; p samples; i product"),
    )  # fmt: skip


class Noise(Kept):
    """``Noise`` of numerics.h."""

    _fields_ = _make_fields("p layers; i n_layers")


class AddedSource(Structure):
    """``AddedSource`` of numerics.h."""

    _fields_ = _make_fields("p add source")


class Alias(Structure):
    """``Alias`` of numerics.h."""

    _fields_ = (("frequency", c_double), ("what", c_char_p))


class Source(Kept):
    """``Source`` of numerics.h."""

    _fields_ = (
        *_make_fields("p sources; i n_sources; p noise; i target start_place; d latest shortest; p aliases"),
        *_make_fields("i n_aliases next_alias; d checked_step"),
        *_make_fields("d origin step start; i first end"), ("rows", c_double * 6 * 32),
    )  # fmt: skip


class Bridge(Structure):
    """``Bridge`` of numerics.h."""

    _fields_ = (
        *((name, c_double * PROCESSES) for name in ("decay", "kick", "power", "total")),
        ("weight", c_double * PROCESSES * PLACES),
    )


class ErrorStream(Structure):
    """``ErrorStream`` of numerics.h."""

    _fields_ = (
        *_make_fields("d interval deviation; i stride block drawn"),
        *((name, c_int64 * 2 * GRIDS) for name in ("number", "made")),
        *_make_fields("p white paths sums"), ("grids", Bridge * GRIDS),
    )  # fmt: skip


class Errors(Kept):
    """``Errors`` of numerics.h."""

    _fields_ = (
        *_make_fields("d density slow walk drift_interval"), ("correlation_times", c_double * (PROCESSES - 1)),
        *_make_fields("i sensors drifts"), ("white_words", c_uint32 * 4), ("drift_words", c_uint32 * 4),
        *_make_fields("p streams; i n_streams oldest"),
    )  # fmt: skip


class White(Kept):
    """``White`` of numerics.h."""

    _fields_ = _make_fields("p words; i n_words channels block drawn; p rows")


class Lowpass(Structure):
    """``Lowpass`` of numerics.h."""

    _fields_ = (*_make_fields("d bandwidth order"), ("state", c_double * 2 * 2), ("input", c_double * 2))


class InertialSensors(Kept):
    """``InertialSensors`` of numerics.h."""

    _fields_ = (
        *_make_fields("i states readings motion start met saturated; p enabled; i n_enabled"),
        *_make_fields("p rows products gain bias range names"), ("ranges", c_double * 2),
        *_make_fields("d sample_time last_sample step"), ("lowpass", Lowpass * 2), ("errors", Errors * 2),
    )  # fmt: skip


class Tracker(Kept):
    """``Tracker`` of numerics.h."""

    _fields_ = (
        *_make_fields("i place sampled acquired error lock visible start payload target"),
        *_make_fields("d acquisition_share acquisition_time sample_time"), ("deviation", c_double * 3),
        ("measured", c_int64 * 3), *_make_fields("i noisy has_warned"), ("words", c_uint32 * 4),
        *_make_fields("i n_words sample"), ("noise", c_double * 3),
    )  # fmt: skip


class Coils(Kept):
    """``Coils`` of numerics.h."""

    _fields_ = (
        *_make_fields("i outputs currents inputs counted start"),
        *_make_fields("d force_constant resistance inductance stroke_factor ripple ripple_factor ripple_phase"),
        *_make_fields("d bandwidth compensation supply_voltage current_limit resolution noise"),
        *_make_fields("d distance stiffness damping effective_mass steps_ahead"),
        *_make_fields("d contact_time fewest_steps longest_step step decay response gain deviation warned_step"),
        ("white", White),
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
        ("add_rows", CFUNCTYPE(None, c_void_p, c_void_p, c_int64, c_void_p)),
        ("draw_lines", CFUNCTYPE(None, c_void_p, c_void_p, c_void_p, c_int64, c_double, c_void_p, c_int64, c_int64)),
        ("draw_keyed", CFUNCTYPE(None, c_void_p, c_int64, c_int64, c_int64, c_void_p)),
        ("add_sources", CFUNCTYPE(None, c_void_p, c_void_p, c_int64, c_void_p)),
        ("make_errors", CFUNCTYPE(None, c_void_p, c_double, c_void_p, c_int64, c_void_p, c_int64)),
        ("make_white", CFUNCTYPE(None, c_void_p, c_int64, c_int64, c_void_p)),
        ("find_tracker_noise", CFUNCTYPE(None, c_void_p, c_int64, c_int64, c_void_p)),
        ("explain_alias", CFUNCTYPE(c_int64, c_void_p, c_double, c_char_p)),
        ("exponential_less_one", CFUNCTYPE(c_double, c_double)),
        # What other structures refer to: addresses.
        *_make_fields("p add_noise add_wheel add_tone add_chirp add_multisine add_recording"),
        *_make_fields("p step_source step_inertial step_tracker step_coils"),
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
def find_function(name: str) -> int:
    """The address of a function, for :class:`ps_fmu.slavekit.author.elements.Call`.  Raises NotCompiledError."""
    return ctypes.cast(getattr(find_library(), name), c_void_p).value or 0


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
