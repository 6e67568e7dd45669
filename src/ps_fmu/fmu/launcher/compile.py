"""What the launcher is compiled from, see :mod:`..native`.  As a program: compile it."""

from __future__ import annotations

import sys
from pathlib import Path

from ..native import CompileError, Program, Target

_LINUX = Target(
    "x86_64-linux-gnu.2.17",
    "launcher.so",
    ("-D_GNU_SOURCE", "-fPIC", "-fvisibility=hidden", "-shared", "-s", "-Wl,-z,nodelete", "-Wl,--build-id=none"),
    ("-lpthread", "-ldl"),
)

LAUNCHER = Program(
    "launcher",
    Path(__file__).parent,
    sources=("text.c", "find.c", "python.c", "instance.c", "kernel.c", "native.c", "launcher.c", "status.c"),
    headers=("text.h", "find.h", "python.h", "instance.h", "core.h", "kernel.h", "product.h", "native.h"),
    targets={"linux64": _LINUX},
)

if __name__ == "__main__":
    try:
        LAUNCHER.make()
    except CompileError as error:
        sys.exit(str(error))
