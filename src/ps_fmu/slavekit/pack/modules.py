"""The Python modules inside an FMU: one archive with their byte code, which Python imports from as it is.

So a start compiles nothing, and unpacks one file instead of a hundred.  Byte code is used only by a Python of the
version that made it, and only as long as the source beside it is the one that it was made from (PEP 552): otherwise the
source is compiled.
"""

from __future__ import annotations

import hashlib
import py_compile
import sys
import tempfile
import zipfile
from functools import lru_cache
from pathlib import Path, PurePosixPath
from py_compile import PycInvalidationMode

from . import zip_writer
from .sources import LIBRARIES, Files

# Of a text of one letter there is one object in a process, and byte code has it in another way where it is interned, by
# whatever has been imported before.
_INTERNED = [sys.intern(chr(code)) for code in range(256)]


def pack_modules(package: str, files: Files) -> tuple[str, Files]:
    """The files of a package as they lie in an FMU.

    What lies in the package itself stays a file, the script of the FMU above all; so does all of a package that has
    compiled libraries, which cannot be loaded from an archive.

    Parameters
    ----------
    package: its name in the FMU.
    files: Python sources and what lies beside them, by their place in the package.

    Returns
    -------
    tuple: name of the archive, made from its content; the files, the archive among them.  The same in any process of
        one version of Python.
    """
    with_libraries = {name.parents[1] for name in files if name.suffix in LIBRARIES}
    loose: Files = {}
    archived: Files = {}
    for name, content in files.items():
        is_loose = name.parent == PurePosixPath() or not with_libraries.isdisjoint(name.parents)
        place = loose if is_loose else archived
        place[name] = content
        if name.suffix == ".py":
            code = _compile(content, f"{package}/{name}")
            cached = name.parent / "__pycache__" / f"{name.stem}.{sys.implementation.cache_tag}.pyc"
            place[cached if is_loose else name.with_suffix(".pyc")] = code
    archive = zip_writer.make(archived, zipfile.ZIP_STORED)  # the FMU compresses it
    modules = f"modules_{hashlib.sha256(archive).hexdigest()[:12]}.zip"
    return modules, loose | {PurePosixPath(modules): archive}


def compile_module(source: bytes, name: str, checked: bool = True) -> bytes:
    """The content of a .pyc file, the same in any process of one version of Python.

    Parameters
    ----------
    source: Python source.
    name: the file, for tracebacks.
    checked: whether Python compares it with the source before each use.

    Raises PyCompileError for what is no Python.
    """
    mode = PycInvalidationMode.CHECKED_HASH if checked else PycInvalidationMode.UNCHECKED_HASH
    with tempfile.TemporaryDirectory() as folder:
        script, result = Path(folder, "module.py"), Path(folder, "module.pyc")
        script.write_bytes(source)
        py_compile.compile(str(script), str(result), name, doraise=True, optimize=0, invalidation_mode=mode)
        return result.read_bytes()


_compile = lru_cache(maxsize=1024)(compile_module)  # the FMUs of a folder have most of their modules in common
