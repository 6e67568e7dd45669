"""The Python modules inside an FMU, and the script that pythonfmu's native library starts from.

One archive has the modules with their byte code, which Python imports from as it is.
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
from collections.abc import Iterable
from functools import lru_cache
from pathlib import Path, PurePosixPath
from py_compile import PycInvalidationMode

from ...files.archive import make_zip
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
    archive = make_zip(archived, zipfile.ZIP_STORED)  # the FMU compresses it
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


_SOURCE = '''\
"""Entry point of this FMU: the native library executes this file at each instantiation.

It takes the class that is defined here; the model itself is {place}.
"""

import importlib
import os
import sys
import traceback

try:
    for _folder in sys.path:
        if _is_here := os.path.isfile(os.path.join(_folder, __name__ + ".py")):
            break
    # The name of the package is made from its content: what another FMU has loaded of it is right for this one, too,
    # and stays so when that one's folder is gone.  Each FMU has only the modules that it needs: the others are here,
    # in the folder of the package and in an archive in it.  The library may execute this again at once: then all is
    # done, and the folder is not in sys.path any longer.
    importlib.import_module("{package}")
    _home = os.path.join(_folder, "{package}")
    for _name, _module in list(sys.modules.items()) if _is_here else ():
        if (_name + ".").startswith("{package}.") and hasattr(_module, "__path__"):
            _inside = "".join(os.sep + _part for _part in _name.split(".")[1:])
            for _top in (_home, os.path.join(_home, "{modules}")):
                if _top + _inside in _module.__path__ or not (_top != _home or os.path.isdir(_home + _inside)):
                    continue
                sys.path_importer_cache.pop(_top + _inside, None)  # it may remember an earlier folder of this name
                _kept = [_old for _old in _module.__path__ if os.path.exists(_old.removesuffix(_inside))]
                _module.__path__ = [*_kept, _top + _inside]
    globals()["{model}"] = {load}
    _guard = importlib.import_module("{package}.slavekit.author.guard")
    _guard.keep_alive(globals())  # see there
    if locals() is not globals():  # of the library, which looks there for the name of the class and then in the module
        {model} = _guard.find_stand_in()
except BaseException as _error:
    _report = traceback.TracebackException.from_exception(_error)
    _own = __name__ + ".py", "pythonfmu_slave.py", os.path.join("importlib", "__init__.py")
    for _frame in list(_report.stack):
        if _frame.filename.startswith("<frozen importlib") or _frame.filename.endswith(_own):
            _report.stack.remove(_frame)
    _report = "".join(_report.format())
    print(_report, end="", file=sys.stderr)  # the library tells only hosts that log
    # It logs what repr() gives, which has to be safe as a printf format.
    _failure = type("Failure", (ImportError,), {{"__repr__": ImportError.__str__}})
    raise _failure(_report.replace("%", "%%")) from None
finally:
    if os.path.isfile(os.path.join(sys.path[0], __name__ + ".py")):
        # One entry more at each instantiation, by the library.  Imports in other threads may be iterating over this
        # list: they would miss the entry after the one they have come to.
        sys.path = sys.path[1:]
'''


def write_entry(package: str, modules: str, module: str, model: str) -> bytes:
    """The script for class ``model`` in ``package.module``; ``modules`` is the archive in the package's folder."""
    load = f'importlib.import_module("{package}.{module}").{model}'
    return _fill(package, modules, f"{package}/{module}.py", model, load)


def write_loading_entry(package: str, modules: str, private: str, module: str, names: Iterable[str]) -> bytes:
    """The script for a slave in ``module.py`` beside it.

    Parameters
    ----------
    package: the part of ps_fmu in the FMU.
    modules: the archive in its folder.
    private: the package that the author's modules are kept in.
    names: modules and packages of the FMU, see :func:`..author.pythonfmu_slave.load_slave`.
    """
    arguments = f'"{private}", {tuple(names)!r}, "{module}", _folder'
    load = f'importlib.import_module("{package}.slavekit.author.pythonfmu_slave").load_slave({arguments})'
    return _fill(package, modules, f"{module}.py", "SlaveOfThisFmu", load)


def _fill(package: str, modules: str, place: str, model: str, load: str) -> bytes:
    return _SOURCE.format(package=package, modules=modules, place=place, model=model, load=load).encode()
