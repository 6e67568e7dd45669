"""The process of one isolated FMU: maps the memory that it shares with the master, and serves.

It is run as a file, ``python -I guest.py LIBRARY DESCRIPTOR BYTES MASTER SPIN``, so that it imports nothing else of the
package: 20 ms instead of 300.  LIBRARY is the compiled :data:`.program.ISOLATION`.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import sys


def serve(library: str, descriptor: int, size: int, master: int, spin_ns: int) -> None:
    """Carry out what the process ``master`` writes into the memory of ``size`` bytes; never returns."""
    memory = mmap.mmap(descriptor, size)
    os.close(descriptor)
    address = ctypes.addressof(ctypes.c_char.from_buffer(memory))
    types = ctypes.c_void_p, ctypes.c_int, ctypes.c_int64
    function = ctypes.CDLL(library).serve_isolated
    function.argtypes = types
    function(address, master, spin_ns)


if __name__ == "__main__":
    serve(sys.argv[1], *map(int, sys.argv[2:]))
