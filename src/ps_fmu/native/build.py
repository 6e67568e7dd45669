"""What is compiled of this folder, and how: ``make launcher``.  Everywhere the same bytes come from the same sources.

The compiler is zig's, from PyPI, of one exact release: it brings its own headers and the interfaces of an old glibc,
so that nothing of the machine it runs on gets into what it makes.  What was made is part of the package, so users need
no compiler.

==============  =====================================================================================================
program         what it is
==============  =====================================================================================================
``launcher``    the library of an FMU that hosts load, in front of pythonfmu's own.  ``text.c``: texts and paths;
                ``find.c``: which Python; ``python.c``: attaching, starting, threads; ``instance.c``: instances and
                their messages; ``native.c``: what is done without Python; ``floats.c``: floating-point settings;
                ``launcher.c``, ``status.c``: the functions of FMI 2.0; ``platform.h`` and the folders ``posix`` and
                ``windows``: what differs between operating systems
``numerics``    the arithmetic of :mod:`ps_fmu.numerics`, and steps in C, which FMUs carry.  ``mechanism``: any motion;
                ``plant``: its step; ``control``: poses, gains, motion profiles; steps of isolator, pointing controller,
                commander
``loop``        the master's loop, and what guards it from FMUs in its process
``isolation``   what the master and the processes of isolated FMUs run
``reduction``   the reduction of recorded rows
``host``        a host that knows FMI 2.0 only, for ``ps-fmu check``.  ``host.c``: the life; ``task.c``: its input;
                ``report.c``: its output; ``settings.c``: what no FMU may change
==============  =====================================================================================================

``kernel`` has what steps a plain slave, with its elements: the launcher has it, and numerics for steps in Python.
"""

from __future__ import annotations

import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from . import FOLDER, RECORD

COMPILER = "0.17.0"  # of ziglang; the same is asked for in pyproject.toml
PLATFORMS = {
    "linux64": "x86_64-linux-gnu.2.17",
    "aarch64-linux": "aarch64-linux-gnu.2.17",  # pythonfmu 0.7 has no library for it that a launcher could go with
    "win64": "x86_64-windows-gnu",
}
"""Platforms of FMI, and what zig calls them."""
_FLAGS = ("-std=c99", "-O2", "-g0", "-Wall", "-Wextra", "-Werror", "-D_GNU_SOURCE", "-s", "-Wl,--build-id=none")
_LIBRARY_ON_LINUX = ("-fPIC", "-fvisibility=hidden")  # on Windows it is so


class CompileError(RuntimeError):
    """A program that cannot be compiled; the text says why."""


@dataclass(frozen=True)
class Part:
    """Sources, by their place in this folder, with flags and libraries of the system that they need."""

    sources: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()
    libraries: tuple[str, ...] = ()


@dataclass(frozen=True)
class Program:
    """A library or program: what it has everywhere, and in addition on Linux and on Windows."""

    name: str
    common: Part
    linux: Part
    windows: Part | None = None
    platforms: tuple[str, ...] = ("linux64", "aarch64-linux")
    is_library: bool = True

    def name_file(self, platform: str) -> str:
        """What its file for a platform is called."""
        if not self.is_library:
            return self.name
        return f"{self.name}.dll" if platform == "win64" else f"{self.name}.so"

    def list_sources(self, platform: str) -> tuple[str, ...]:
        """All sources for a platform."""
        return self.common.sources + self._get_part(platform).sources

    def list_flags(self, platform: str) -> tuple[str, ...]:
        """All flags for a platform."""
        flags = list(_FLAGS)
        if self.is_library:
            flags.append("-shared")
            flags += _LIBRARY_ON_LINUX if platform != "win64" else ()
        return (*flags, *self.common.flags, *self._get_part(platform).flags)

    def list_libraries(self, platform: str) -> tuple[str, ...]:
        """Libraries of the system that it is linked with."""
        return self.common.libraries + self._get_part(platform).libraries

    def _get_part(self, platform: str) -> Part:
        part = self.windows if platform == "win64" else self.linux
        assert part is not None
        return part


def _place(folder: str, *names: str) -> tuple[str, ...]:
    return tuple(f"{folder}/{name}.c" for name in names)


_KERNEL = _place("kernel", "kernel", "elements", "timed")
_CONTROL = _place("control", "poses", "gains", "isolator", "pointing", "profile", "commander")
_PYTHON = _place("launcher", "text", "find", "floats", "python", "instance")
_CALLS = _place("launcher", "native", "launcher", "status")
_SYSTEM = "paths", "programs", "libraries", "threads", "belongings"

_PROGRAMS = (
    Program(
        "launcher",
        Part(_PYTHON + _KERNEL + _CALLS),
        # -flto: what a call goes through lies in four sources; a macro step of four FMUs is 3 to 5 % cheaper for it.
        Part(_place("launcher/posix", *_SYSTEM), ("-flto", "-Wl,-z,nodelete"), ("-lpthread", "-ldl", "-lm")),
        Part(_place("launcher/windows", *_SYSTEM, "wide"), ("-D__USE_MINGW_ANSI_STDIO=0",)),  # Windows' own printf
        tuple(PLATFORMS),
    ),
    Program(
        "numerics",
        Part(
            (
                *_place("numerics", "numerics", "sse2", "avx2", "avx512", "expm"),
                *_place("mechanism", "equations", "mechanism"),
                *_place("plant", "plant", "model"),
                *_CONTROL,
                *_KERNEL,
            ),
            ("-O3", "-fno-math-errno", "-ffp-contract=off"),
        ),
        Part(libraries=("-lm",)),
        Part(flags=("-D__USE_MINGW_ANSI_STDIO=0",)),
        tuple(PLATFORMS),
    ),
    Program(
        "loop",
        # Without contraction the same numbers come out where a processor can multiply and add at once.
        Part(_place("loop", "loop", "guard", "effects"), ("-ffp-contract=off",)),
        Part(libraries=("-ldl", "-lm", "-lpthread")),
    ),
    Program(
        "isolation",
        Part(_place("isolation", "client", "later", "guest")),
        Part(libraries=("-ldl", "-lm", "-lpthread")),
        platforms=("linux64",),
    ),
    Program("reduction", Part(_place("reduction", "reduction", "sse2", "avx2", "avx512")), Part()),
    Program(
        "host",
        Part(_place("host", "host", "task", "report", "settings")),
        Part(libraries=("-ldl", "-lm")),
        platforms=("linux64",),
        is_library=False,
    ),
)
PROGRAMS = {program.name: program for program in _PROGRAMS}


def compile_program(program: Program, platform: str, folder: Path = FOLDER) -> bytes:
    """A program for a platform, compiled now from the sources in ``folder``.  Raises CompileError."""
    import importlib.metadata

    try:
        installed = importlib.metadata.version("ziglang")
    except importlib.metadata.PackageNotFoundError:
        installed = "none"
    if installed != COMPILER:
        raise CompileError(f"ziglang {COMPILER} is needed, {installed} is installed: pip install ziglang=={COMPILER}")
    with tempfile.TemporaryDirectory() as temporary:
        result = Path(temporary) / program.name_file(platform)  # a DLL tells its name
        command = [sys.executable, "-I", "-m", "ziglang", "cc", "-target", PLATFORMS[platform]]
        command += [*program.list_flags(platform), "-I", str(find_fmi_headers()), *program.list_sources(platform)]
        command += ["-o", str(result), *program.list_libraries(platform)]
        environment = os.environ | {"ZIG_LOCAL_CACHE_DIR": temporary}
        run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
        if run.returncode != 0:
            raise CompileError(f"{program.name} for {platform}: the compiler says:\n{run.stderr}")
        return result.read_bytes()


def describe(made: Mapping[str, Mapping[str, bytes]]) -> str:
    """The text of the record for what was made, by platform and file.

    Compiler, commands and the SHA-256 of all files that go in: where they are equal, so are the results.
    """
    sources = [path for path in sorted(FOLDER.rglob("*.[ch]"))]
    headers = sorted(find_fmi_headers().glob("fmi2*.h"))
    content = {
        "compiler": f"ziglang {COMPILER}",
        "commands": {
            f"{platform}/{program.name_file(platform)}": " ".join(
                (*program.list_flags(platform), *program.list_sources(platform), *program.list_libraries(platform))
            )
            for program in _PROGRAMS
            for platform in program.platforms
        },
        "sources": {path.relative_to(FOLDER).as_posix(): _compute_digest(path.read_bytes()) for path in sources}
        | {path.name: _compute_digest(path.read_bytes()) for path in headers},
        "made": {
            platform: {file: _compute_digest(data) for file, data in files.items()} for platform, files in made.items()
        },
    }
    return json.dumps(content, indent=2) + "\n"


def make_all() -> None:
    """Compile all programs for all platforms, into this folder.  Raises CompileError."""
    made: dict[str, dict[str, bytes]] = {platform: {} for platform in PLATFORMS}
    for program in _PROGRAMS:
        for platform in program.platforms:
            made[platform][program.name_file(platform)] = compile_program(program, platform)
    for platform, files in made.items():
        for file, content in files.items():
            path = FOLDER / platform / file
            path.parent.mkdir(exist_ok=True)
            path.write_bytes(content)
            print(f"{path}  {len(content) / 1e3:.0f} kB")
    (FOLDER / RECORD).write_text(describe(made), encoding="utf-8")


def find_fmi_headers() -> Path:
    """The folder of FMI's C headers, which FMPy's wheel carries."""
    import fmpy

    return Path(fmpy.__file__).parent / "c-code"


def _compute_digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
