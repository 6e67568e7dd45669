"""What the C host is compiled from, see :mod:`ps_fmu.slavekit.launcher.c_program`.  As a program: compile it."""

from __future__ import annotations

import sys
from pathlib import Path

from ...slavekit.launcher.c_program import CompileError, Program, Target

HOST = Program(
    "host",
    Path(__file__).parent,
    sources=("host.c", "task.c", "report.c", "settings.c"),
    headers=("task.h", "report.h", "settings.h"),
    targets={
        "linux64": Target(
            "x86_64-linux-gnu.2.17", "host", ("-D_GNU_SOURCE", "-s", "-Wl,--build-id=none"), ("-ldl", "-lm")
        )
    },
)

if __name__ == "__main__":
    try:
        HOST.make()
    except CompileError as error:
        sys.exit(str(error))
