"""The compiled library of this room."""

from __future__ import annotations

import logging
import platform
import sys
from ctypes import CDLL, c_double, c_int64, c_void_p
from functools import cache

from .native import REDUCTION

log = logging.getLogger("ps_fmu.reduction")


@cache
def find_library() -> CDLL | None:
    """The library; None if there is none for this platform, or none that can be loaded."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return None
    try:
        library = CDLL(str(REDUCTION.find_whole("linux64")))
    except OSError as error:
        log.info("rows are filtered and counted in numpy: %s", error)
        return None
    library.filter_rows.argtypes, library.filter_rows.restype = (c_void_p, c_void_p, c_int64, c_void_p), None
    types = c_void_p, c_int64, c_double, c_void_p, c_void_p, c_void_p
    library.add_values.argtypes, library.add_values.restype = types, None
    return library
