"""What the launcher is compiled from, see :mod:`.c_program`.  As a program: compile it."""

from __future__ import annotations

import sys
from pathlib import Path

from .c_program import CompileError, Program, Target

_HEADERS = (
    "text.h", "find.h", "python.h", "instance.h", "core.h", "kernel.h", "elements.h", "product.h", "native.h",
    "floats.h", "platform.h", "windows/wide.h", "../../processor.h",
)  # fmt: skip
_PARTS = ("paths.c", "programs.c", "libraries.c", "threads.c", "belongings.c")
# -flto: what a call goes through lies in four sources; a macro step of four FMUs is 3 to 5 % cheaper for it.
_LINUX_FLAGS = (
    "-D_GNU_SOURCE", "-flto", "-fPIC", "-fvisibility=hidden", "-shared", "-s", "-Wl,-z,nodelete", "-Wl,--build-id=none",
)  # fmt: skip


def _linux(zig: str) -> Target:
    return Target(
        zig,
        "launcher.so",
        _LINUX_FLAGS,
        ("-lpthread", "-ldl", "-lm"),
        tuple(f"posix/{name}" for name in _PARTS),
    )


_WINDOWS = Target(
    "x86_64-windows-gnu",
    "launcher.dll",
    ("-D_GNU_SOURCE", "-D__USE_MINGW_ANSI_STDIO=0", "-shared", "-s", "-Wl,--build-id=none"),  # Windows' own printf
    sources=tuple(f"windows/{name}" for name in (*_PARTS, "wide.c")),
)

LAUNCHER = Program(
    "launcher",
    Path(__file__).parent,
    sources=(
        "text.c", "find.c", "floats.c", "python.c", "instance.c", "kernel.c", "elements.c", "timed.c", "native.c",
        "launcher.c", "status.c",
    ),
    headers=_HEADERS,
    targets={
        "linux64": _linux("x86_64-linux-gnu.2.17"),
        "aarch64-linux": _linux("aarch64-linux-gnu.2.17"),  # pythonfmu 0.7 has no library for it to go with
        "win64": _WINDOWS,
    },
)

if __name__ == "__main__":
    try:
        LAUNCHER.make()
    except CompileError as error:
        sys.exit(str(error))
