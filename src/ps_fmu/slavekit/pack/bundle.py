"""A Python of its own for an FMU: interpreter, standard library without its rarer parts, and the packages it needs.

The bundle is a copy of the Python that runs this.  It runs on Linux of the same architecture, with a glibc that is at
least as new as the one that this Python and its packages were built for.  The interpreter's own libraries lose their
debug information (which saves 10 MB); those of packages stay as they were installed.  The launcher finds the bundle
beside itself, in the folder ``python``::

    bundle.txt                what the launcher has to know
    lib/libpython3.11.so.1.0
    lib/python311.zip         standard library, compiled
    lib/python3.11/lib-dynload, lib/site-packages
    lib/system                shared libraries that the others need and that a machine may lack
"""

from __future__ import annotations

import functools
import importlib.metadata
import json
import re
import struct
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

from ...files.archive import make_zip
from .errors import BuildError
from .licenses import License, collect_runtime_licenses
from .modules import compile_module
from .sources import Files

_ROOT = PurePosixPath("python")
_VERSION = "{}.{}".format(*sys.version_info)
_ZIP = f"lib/python{_VERSION.replace('.', '')}.zip"
_DYNLOAD = f"lib/python{_VERSION}/lib-dynload"
_PACKAGES = "lib/site-packages"

# Of the standard library: tests, user interfaces, tools for developers, and what needs large libraries (OpenSSL,
# SQLite, Tk, readline).  hashlib has implementations of its own.
_LEFT_OUT = {
    "__pycache__", "curses", "dbm", "distutils", "ensurepip", "idlelib", "lib2to3", "pydoc_data", "site-packages",
    "sqlite3", "test", "tests", "tkinter", "turtle.py", "turtledemo", "venv",
}  # fmt: skip
_EXTENSIONS_LEFT_OUT = (
    "_crypt", "_ctypes_test", "_curses", "_dbm", "_gdbm", "_hashlib", "_sqlite3", "_ssl", "_test", "_tkinter", "_uuid",
    "_xx", "nis", "ossaudiodev", "readline", "spwd", "xx",
)  # fmt: skip
# Of packages: what is only for developing with them, and for testing them.
_PACKAGE_PARTS_LEFT_OUT = {"__pycache__", "tests", "include", "_pyinstaller"}
_PACKAGE_FILES_LEFT_OUT = (".pyi", ".pxd", ".h", ".a", ".pyc", ".typed")

_IDENTITY = b"\x7fELF\x02\x01"  # 64 bits, little-endian
_HEADER = struct.Struct("<16sHHIQQQIHHHHHH")
_SEGMENT = struct.Struct("<IIQQQQQQ")

# Part of every Linux that can load the launcher and pythonfmu's library.
_ALWAYS_THERE = (
    "ld-linux", "libc.so", "libc-", "libdl", "libgcc_s", "libm.so", "libm-", "libpthread", "librt", "libstdc++",
    "libutil",
)  # fmt: skip


@dataclass(frozen=True)
class Bundle:
    """The folder ``python`` as files by name, and the licences of what is in it."""

    files: Files
    licenses: tuple[License, ...]


def bundle(modules: Sequence[str], requirements: Sequence[str] = ()) -> Bundle:
    """This Python with some installed packages.  Raises BuildError.

    Parameters
    ----------
    modules: what is imported, for example ``yaml``.
    requirements: further packages by the names of their distributions, for example ``PyYAML``.
    """
    return _make_bundle(tuple(modules), tuple(requirements))


@functools.lru_cache(maxsize=1)  # FMUs that are built one after the other mostly need the same; it takes 3 s
def _make_bundle(modules: tuple[str, ...], requirements: tuple[str, ...]) -> Bundle:
    if sys.platform != "linux":
        raise BuildError("a runtime can be bundled on Linux only")
    standard = Path(sysconfig.get_path("stdlib"))
    all_extensions = _list_extensions(standard / "lib-dynload")
    absent = [name for name in all_extensions if name.startswith(_EXTENSIONS_LEFT_OUT)]
    extensions = {name: path for name, path in all_extensions.items() if name not in absent}
    distributions = _find_distributions(modules, requirements)
    packages = dict(_read_packages(distributions))
    libraries = {path.name: path for path in _find_libraries([*extensions, *modules], absent)}
    libpython = _find_libpython()
    notes = {
        "version": _VERSION,
        "library": f"lib/{libpython.name}",
        "entries": ":".join((_ZIP, _DYNLOAD, *([_PACKAGES] if packages else []))),  # the launcher looks for all of them
        "packages": _PACKAGES,
        "preload": ":".join(f"lib/system/{name}" for name in sorted(libraries)),
    }
    files = {
        "bundle.txt": "".join(f"{key}={value}\n" for key, value in notes.items()).encode(),
        notes["library"]: cut_unloaded(libpython.read_bytes()),
        _ZIP: _pack_standard_library(standard),
    }
    files |= {f"{_DYNLOAD}/{path.name}": cut_unloaded(path.read_bytes()) for path in extensions.values()}
    files |= {f"{_PACKAGES}/{name}": content for name, content in packages.items()}
    files |= {f"lib/system/{name}": path.read_bytes() for name, path in libraries.items()}
    licenses = tuple(collect_runtime_licenses(distributions, list(libraries.values())))
    return Bundle({_ROOT / name: content for name, content in files.items()}, licenses)


def check(fmu: Path) -> None:
    """Run the model of an FMU with what is in its bundle, and nothing else.  Raises BuildError if it fails."""
    with tempfile.TemporaryDirectory(prefix="ps_fmu_bundle_") as folder, zipfile.ZipFile(fmu) as content:
        content.extractall(folder)
        command = [sys.executable, "-I", "-S", "-B", "-c", _TRIAL, folder, f"binaries/linux64/{_ROOT}"]
        run = subprocess.run(command, capture_output=True, encoding="utf-8", errors="replace")
    if run.returncode != 0:
        raise BuildError(f"the model does not run with what is bundled:\n{run.stderr}")


# The life of a slave without a host, since there is none that comes without Python.
_TRIAL = """
import os, sys
folder, home = sys.argv[1], os.path.join(*sys.argv[1:])
notes = dict(line.rstrip().split("=", 1) for line in open(os.path.join(home, "bundle.txt")))
sys.path[:] = [os.path.join(home, entry) for entry in notes["entries"].split(":")]
sys.path.insert(0, os.path.join(folder, "resources"))
import importlib, xml.etree.ElementTree
description = xml.etree.ElementTree.parse(os.path.join(folder, "modelDescription.xml")).getroot()
experiment = description.find("DefaultExperiment")
experiment = experiment.attrib if experiment is not None else {}
start, step = float(experiment.get("startTime", "0")), float(experiment.get("stepSize", "0.01"))
resources = os.path.join(folder, "resources")
with open(os.path.join(resources, "slavemodule.txt")) as name:
    (model,) = [c for c in vars(importlib.import_module(name.read().strip())).values() if isinstance(c, type)]
slave = model(instance_name="trial", resources=resources)
slave.setup_experiment(start, None, None)
slave.enter_initialization_mode()
slave.exit_initialization_mode()
slave.do_step(start, step)
slave.do_step(start + step, step)
"""


def _find_libpython() -> Path:
    name = sysconfig.get_config_var("INSTSONAME") or ""
    folders = (sysconfig.get_config_var("LIBDIR") or "", f"{sys.base_prefix}/lib")
    for folder in folders:
        if ".so" in name and (Path(folder) / name).is_file():
            return Path(folder) / name
    raise BuildError(f"{sys.executable} was built without a shared libpython (looked in {', '.join(folders)})")


@functools.cache  # 2.5 s, the same for all FMUs
def _pack_standard_library(folder: Path) -> bytes:
    files: Files = {}
    for path in folder.rglob("*.py"):
        name = PurePosixPath(path.relative_to(folder))
        if not _LEFT_OUT.intersection(name.parts) and not any("config-" in part for part in name.parts):
            files[name.with_suffix(".pyc")] = compile_module(path.read_bytes(), str(name), checked=False)
    return make_zip(files, zipfile.ZIP_STORED)  # the FMU compresses it


def _list_extensions(folder: Path) -> dict[str, Path]:
    """Name and file of the standard library's compiled modules."""
    return {path.name.partition(".")[0]: path for path in sorted(folder.glob("*.so"))}


def _find_distributions(modules: Iterable[str], requirements: Iterable[str]) -> list[str]:
    """The installed distributions that provide some modules and requirements, and those that these need in turn."""
    providers = importlib.metadata.packages_distributions()
    missing = [module for module in modules if module not in providers]
    waiting = [*requirements, *(providers[module][0] for module in modules if module in providers)]
    found: dict[str, str] = {}
    for name in waiting:  # grows
        key = re.sub(r"[-_.]+", "-", name).lower()
        if key in found:
            continue
        try:
            distribution = importlib.metadata.distribution(name)
        except (importlib.metadata.PackageNotFoundError, ValueError):
            if name in requirements:
                missing.append(name)
            continue  # needed on other systems only
        found[key] = distribution.metadata["Name"]
        needs = [need for need in distribution.requires or () if "extra ==" not in need]
        waiting += [re.split(r"[^A-Za-z0-9._-]", need, maxsplit=1)[0] for need in needs]
    if missing:
        names = ", ".join(missing)
        raise BuildError(f"the FMU needs {names}, which is not installed here: install it beside ps_fmu")
    return list(found.values())


def _read_packages(distributions: Iterable[str]) -> Iterator[tuple[str, bytes]]:
    """The installed files of some distributions, Python sources compiled."""
    for distribution in distributions:
        for file in importlib.metadata.files(distribution) or ():
            if ".." in file.parts or _PACKAGE_PARTS_LEFT_OUT.intersection(file.parts):
                continue
            path, name = Path(str(file.locate())), str(file)
            if name.endswith(".py"):
                yield f"{name}c", compile_module(path.read_bytes(), name, checked=False)
            elif not name.endswith(_PACKAGE_FILES_LEFT_OUT) and file.name not in ("RECORD", "INSTALLER", "REQUESTED"):
                yield name, path.read_bytes()


def _find_libraries(modules: Iterable[str], absent: Iterable[str]) -> list[Path]:
    """The shared libraries that some modules load, without those in their packages and those of every Linux.

    ``absent`` are modules that the bundle lacks: they cannot be imported meanwhile.
    """
    program = (
        "import importlib, json, sys\n"
        "absent, present = (part.split() for part in sys.argv[1:])\n"
        "sys.modules.update(dict.fromkeys(absent))\n"
        "for name in present: importlib.import_module(name)\n"
        "maps = [line.split(None, 5) for line in open('/proc/self/maps')]\n"
        "print(json.dumps(sorted({m[5].strip() for m in maps if len(m) == 6 and '.so' in m[5]})))\n"
    )
    command = [sys.executable, "-I", "-c", program, " ".join(absent), " ".join(modules)]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode != 0:
        raise BuildError(f"a module to be bundled cannot be imported:\n{run.stderr}")
    inside = tuple(str(Path(sysconfig.get_path(name)).resolve()) for name in ("stdlib", "platlib"))
    mapped = [Path(path) for path in json.loads(run.stdout)]
    return [
        path
        for path in mapped
        if not path.name.startswith((*_ALWAYS_THERE, "libpython")) and not str(path.resolve()).startswith(inside)
    ]


def cut_unloaded(content: bytes) -> bytes:
    """A shared library without debug information, symbol table and section headers: cut behind its last segment.

    Dynamic linkers look at segments only (System V ABI, chapter 5).  What is not a complete ELF file of 64 bits stays
    as it is.  ``zig objcopy`` is not implemented for ELF (ziglang 0.17), and ``strip`` need not be installed.
    """
    if not content.startswith(_IDENTITY) or len(content) < _HEADER.size:
        return content
    header = list(_HEADER.unpack_from(content))
    table, size, count = header[5], header[9], header[10]
    if size != _SEGMENT.size or not count or table + size * count > len(content):
        return content
    end = table + size * count
    for k in range(count):
        _, _, offset, _, _, in_file, _, _ = _SEGMENT.unpack_from(content, table + k * size)
        end = max(end, offset + in_file)
    if end > len(content):
        return content
    header[6] = header[12] = header[13] = 0  # place and number of section headers, the one with their names
    return _HEADER.pack(*header) + content[_HEADER.size : end]
