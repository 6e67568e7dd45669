"""Has pythonfmu's native library let go of its interpreter state once, not twice, when the process ends.

The library (0.7.0, Linux) holds that state in a static shared pointer and drops it in a destructor of the library as
well, which at exit runs after the pointer itself was destroyed.  The second release writes to freed memory: hosts not
written in Python abort, Python hosts do so now and then ("corrupted double-linked list").  The library exports the
function that drops the state; called by the interpreter's own exit, it leaves nothing for the second release.
"""

from __future__ import annotations

import _ctypes
import atexit
import ctypes
import os
import sys
from pathlib import Path

_libraries: dict[int, str] = {}
"""Address of ``finalizePythonInterpreter`` -> path of its library."""


def finalize_once(resources: str, model: str) -> None:
    """Have the state dropped when Python ends, if the FMU's library is still loaded then.

    Does nothing where the library is not found: on other systems, or loaded from elsewhere than this FMU.

    Parameters
    ----------
    resources: path of the FMU's ``resources`` folder.
    model: the FMU's model identifier.
    """
    if sys.platform != "linux":
        return
    path = str(Path(resources).resolve().parent / "binaries" / "linux64" / f"{model}.so")
    try:
        library = ctypes.CDLL(path, mode=os.RTLD_NOLOAD | os.RTLD_NOW)
    except OSError:
        return
    address = ctypes.cast(library.finalizePythonInterpreter, ctypes.c_void_p).value
    _ctypes.dlclose(library._handle)  # hosts that run many copies of an FMU count on unloading them
    if address is not None:
        _libraries[address] = path


@atexit.register
def _finalize() -> None:
    # Not by dlopen whether they are still loaded: the thread that ends Python may wait for this one with the
    # loader's lock held.
    mapped = Path("/proc/self/maps").read_text(errors="replace").splitlines() if _libraries else []
    for line in mapped:
        first, last = (int(word, 16) for word in line.split(" ", 1)[0].split("-"))
        for address, path in _libraries.items():
            if first <= address < last and path in line:
                ctypes.CFUNCTYPE(None)(address)()
