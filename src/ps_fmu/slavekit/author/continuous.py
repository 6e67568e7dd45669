"""Models that state their differential equations: steps of any size, whose map is made in C for the step that comes."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int64, c_void_p

from ...numerics.library import Discretisation, find_function, find_library
from .blocks import LANES, MapWords, Room, store_by_columns
from .buffer import Array, allocate_aligned
from .elements import Call
from .instructions import find_address

_HELD_MAPS = 4


class _HeldMap(ctypes.Structure):
    """``HeldMap`` of ``native/numerics/expm.h``."""

    _fields_ = (("step", c_double), ("by_columns", c_void_p), ("room", Room), ("map", MapWords))


class _HeldMaps(ctypes.Structure):
    """``HeldMaps`` of ``native/numerics/expm.h``."""

    _fields_ = (("work", Discretisation), ("maps", _HeldMap * _HELD_MAPS), ("oldest", c_int64))


def hold_inputs(A: Array, B: Array, source: Array, target: Array) -> Call:
    """An element that makes the first map of the core ``target <- Ad x + Bd [u; a]`` for the step under way.

    Parameters
    ----------
    A, B: see :meth:`.model.Model.continuous`.
    source: [x; u; a] in the buffer.
    target: x there.
    """
    (n, m), library = B.shape, find_library()
    by_columns, stride = (store_by_columns(A), store_by_columns(B)), -(-n // LANES) * LANES
    room, work = allocate_aligned(library.discretise_room(n)), allocate_aligned(stride)
    given = map(find_address, by_columns)
    arguments = _HeldMaps(Discretisation(n, m, stride, 0.0, *given, room=find_address(room)))
    kept: list[object] = [by_columns, room, work]
    for held in arguments.maps:
        blocks, place = Room(n + m, stride // LANES), allocate_aligned(n + m, stride)
        held.by_columns, held.room = find_address(place), blocks
        held.map.source, held.map.target, held.map.work = map(find_address, (source, target, work))
        held.map.n_target = n
        kept += [blocks.arrays, place]
    return Call(find_function("use_held_map"), arguments, kept=kept)
