"""The master's loop in C, which :mod:`..compiled` uses.

``python -m ps_fmu.cosim.native`` makes the library from ``loop.c``, ``guard.c``, ``effects.c`` and their
headers, see :mod:`ps_fmu.slavekit.launcher.c_program`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from platform import machine

from fmpy import platform

from ...slavekit.launcher.c_program import Program, Target

PLATFORM = "aarch64-linux" if sys.platform == "linux" and machine() == "aarch64" else platform
"""The platform here, as folders of binaries are called; FMPy takes each 64-bit Linux for that of x86."""


def _linux(zig: str) -> Target:
    # Without contraction the same numbers come out where a processor can multiply and add at once.
    flags = "-D_GNU_SOURCE", "-fPIC", "-fvisibility=hidden", "-ffp-contract=off", "-shared", "-s"
    return Target(zig, "loop.so", (*flags, "-Wl,--build-id=none"), libraries=("-ldl", "-lm", "-lpthread"))


LOOP = Program(
    "loop",
    Path(__file__).parent,
    sources=("loop.c", "guard.c", "effects.c"),
    headers=("control_word.h", "lines.h", "effects.h"),
    targets={"linux64": _linux("x86_64-linux-gnu.2.17"), "aarch64-linux": _linux("aarch64-linux-gnu.2.17")},
)
