"""The folder ``documentation`` of an FMU: the page, and what the FMU needs of the machine."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import PurePosixPath
from xml.etree.ElementTree import fromstring

from .page import page
from .sources import Files

_FOLDER = PurePosixPath("documentation")

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

Windows x86-64: python3.dll and an environment with these packages on PATH.
"""

_BUNDLED = """\
What {model}.fmu needs of the machine

Linux x86-64: {libc} or later, and the libstdc++ of GCC 12 or later. CPython with {modules} is in the FMU.

Other systems: CPython {python} or later with {modules}.
"""


def documentation(
    readme: str, description: bytes, terminals: bytes | None, *, python: str, modules: Sequence[str], bundled: bool
) -> Files:
    """The folder without licences.

    Parameters
    ----------
    readme, description, terminals: as for :func:`.page.page`.
    python: the oldest version.
    modules: packages that the slave imports.
    bundled: whether the FMU brings them.
    """
    names = " and ".join(modules) or "its standard library"
    libc = (os.confstr("CS_GNU_LIBC_VERSION") or "glibc") if bundled else ""
    model = fromstring(description).get("modelName")
    needed = (_BUNDLED if bundled else _NEEDED).format(model=model, python=python, modules=names, libc=libc)
    return {
        _FOLDER / "index.html": page(readme, description, terminals),
        _FOLDER / "externalDependencies.txt": needed.encode(),
    }
