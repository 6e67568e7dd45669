"""Compile the launcher, to the same bytes wherever it is done: ``make launcher``.

The compiler is zig's, from PyPI, of one exact release: it brings its own headers and the interfaces of an old glibc,
so that nothing of the machine it runs on gets into the library.  ``launcher.json`` records what a library was made
from.
"""

from __future__ import annotations

import hashlib
import importlib.metadata
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

FOLDER = Path(__file__).parent
COMPILER = "0.17.0"  # of ziglang; the same is asked for in pyproject.toml
SOURCES = ("text.c", "find.c", "python.c", "instance.c", "launcher.c")
HEADERS = ("text.h", "find.h", "python.h", "instance.h")
TARGETS = {"linux64": "x86_64-linux-gnu.2.17"}  # platform of FMI -> target of zig
FLAGS = (
    "-std=c99", "-D_GNU_SOURCE", "-O2", "-g0", "-Wall", "-Wextra", "-Werror", "-fPIC", "-fvisibility=hidden",
    "-shared", "-s", "-Wl,-z,nodelete", "-Wl,--build-id=none",
)  # fmt: skip
LIBRARIES = ("-lpthread", "-ldl")
_RECORD = FOLDER / "launcher.json"


class CompileError(RuntimeError):
    """The launcher cannot be compiled; the text says why."""


def library(platform: str = "linux64") -> Path:
    """The built launcher for a platform."""
    return FOLDER / platform / "launcher.so"


def fmi_headers() -> Path:
    """The folder of FMI's C headers, which FMPy's wheel carries."""
    import fmpy

    return Path(fmpy.__file__).parent / "c-code"


def ingredients() -> dict[str, str]:
    """SHA-256 of all that goes into the launcher, by name; what :data:`_RECORD` holds for the sources."""
    files = {name: FOLDER / name for name in (*SOURCES, *HEADERS)}
    files |= {path.name: path for path in sorted(fmi_headers().glob("fmi2*.h"))}
    return {name: hashlib.sha256(path.read_bytes()).hexdigest() for name, path in files.items()}


def recipe() -> dict[str, object]:
    """Compiler, flags and sources: two equal recipes give equal libraries."""
    return {
        "compiler": f"ziglang {COMPILER}",
        "flags": [*FLAGS, *LIBRARIES],
        "targets": TARGETS,
        "sources": ingredients(),
    }


def record(libraries: Mapping[str, bytes]) -> str:
    """The text of ``launcher.json`` for some built libraries, by platform."""
    hashes = {platform: hashlib.sha256(content).hexdigest() for platform, content in libraries.items()}
    return json.dumps(recipe() | {"libraries": hashes}, indent=2) + "\n"


def compiled(platform: str) -> bytes:
    """The launcher for a platform, compiled now.  Raises CompileError."""
    try:
        installed = importlib.metadata.version("ziglang")
    except importlib.metadata.PackageNotFoundError:
        installed = "none"
    if installed != COMPILER:
        raise CompileError(f"ziglang {COMPILER} is needed, {installed} is installed: pip install ziglang=={COMPILER}")
    with tempfile.TemporaryDirectory() as folder:
        result = Path(folder) / "launcher.so"
        command = [sys.executable, "-m", "ziglang", "cc", "-target", TARGETS[platform], *FLAGS]
        command += ["-I", str(fmi_headers()), *SOURCES, "-o", str(result), *LIBRARIES]
        environment = os.environ | {"ZIG_LOCAL_CACHE_DIR": folder}
        run = subprocess.run(command, cwd=FOLDER, env=environment, capture_output=True, text=True)
        if run.returncode != 0:
            raise CompileError(f"{platform}: the compiler says:\n{run.stderr}")
        return result.read_bytes()


def main() -> None:
    """Compile for all platforms, into the package."""
    libraries = {platform: compiled(platform) for platform in TARGETS}
    for platform, content in libraries.items():
        library(platform).parent.mkdir(exist_ok=True)
        library(platform).write_bytes(content)
        print(f"{library(platform)}  {len(content) / 1e3:.0f} kB")
    _RECORD.write_text(record(libraries), encoding="utf-8")


if __name__ == "__main__":
    try:
        main()
    except CompileError as error:
        sys.exit(f"launcher: {error}")
