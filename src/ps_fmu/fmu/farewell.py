"""Has pythonfmu's native library let go of its interpreter state once, not twice, when the process ends.

The library (0.7.0, Linux) holds that state in a static shared pointer and drops it in a destructor of the library as
well, which runs after the pointer itself was destroyed.  The second release writes to freed memory: hosts not written
in Python abort at exit, Python hosts do so now and then ("corrupted double-linked list").  The library exports the
function that drops the state; called before both, it leaves nothing to release.
"""

from __future__ import annotations

import ctypes
import os
import sys
from pathlib import Path

_registered: set[int] = set()


def finalize_once(resources: str, model: str) -> None:
    """Call the library's ``finalizePythonInterpreter`` first of all when the process exits.

    Does nothing where the library is not found: on other systems, or loaded from elsewhere than this FMU.

    Parameters
    ----------
    resources: path of the FMU's ``resources`` folder.
    model: the FMU's model identifier.
    """
    if sys.platform != "linux":
        return
    library = Path(resources).parent / "binaries" / "linux64" / f"{model}.so"
    try:
        loaded = ctypes.CDLL(str(library), mode=os.RTLD_NOLOAD | os.RTLD_NOW)  # never closed: it must stay loaded
        finalize = ctypes.cast(loaded.finalizePythonInterpreter, ctypes.c_void_p)
        at_exit = ctypes.CDLL(None)["__cxa_atexit"]
    except (OSError, AttributeError):
        return
    if finalize.value is not None and finalize.value not in _registered:
        _registered.add(finalize.value)
        at_exit(finalize, None, None)
