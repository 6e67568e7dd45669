"""The file ``documentation/externalDependencies.txt`` (FMI 2.0.4, 2.3): what an FMU needs of the machine."""

from __future__ import annotations

import os
from collections.abc import Sequence

_NEEDED = """\
What {model}.fmu needs of the machine

CPython {python} or later with {modules}.

Linux x86-64: in a host that runs Python, that Python. Other hosts need not be prepared: the FMU starts a Python, and
looks for it in this order:
  1. PS_FMU_PYTHON=/path/to/python3 in the environment; then nothing else is tried;
  2. the interpreter that it was built with a note of, if any (ps-fmu build --interpreter);
  3. the virtual environment in VIRTUAL_ENV;
  4. python3 on PATH.
It needs a shared libpython (Debian and Ubuntu: package libpython3.x).
If none is fit, fmi2Instantiate fails with one message that says for each why not.

glibc 2.32 or later and the libstdc++ of GCC 12 or later, for pythonfmu's library.

Windows x86-64: the same with python.exe and py.exe in place of python3; python3.dll beside the interpreter's library;
the Microsoft Visual C++ runtime. It was run under Wine, never on Windows.
"""

_BUNDLED = """\
What {model}.fmu needs of the machine

Linux x86-64: {libc} or later, and the libstdc++ of GCC 12 or later. CPython with {modules} is in the FMU.

Other systems: CPython {python} or later with {modules}.
"""


def write_external_dependencies(model: str, python: str, modules: Sequence[str], bundled: bool) -> bytes:
    """The file's content.

    Parameters
    ----------
    model: name of the FMU.
    python: the oldest version.
    modules: packages that the slave imports.
    bundled: whether the FMU brings them.
    """
    names = " and ".join(modules) or "its standard library"
    libc = (os.confstr("CS_GNU_LIBC_VERSION") or "glibc") if bundled else ""
    return (_BUNDLED if bundled else _NEEDED).format(model=model, python=python, modules=names, libc=libc).encode()
