"""The master's loop in C, which :mod:`..compiled` uses.

``python -m ps_fmu.cosim.native`` makes the library from ``loop.c``, ``guard.c``, ``divert.c``, ``effects.c`` and their
headers, see :mod:`ps_fmu.slavekit.launcher.c_program`.
"""

from __future__ import annotations

from pathlib import Path

from ...slavekit.launcher.c_program import Program, Target

_LINUX = Target(
    "x86_64-linux-gnu.2.17",
    "loop.so",
    ("-D_GNU_SOURCE", "-fPIC", "-fvisibility=hidden", "-shared", "-s", "-Wl,--build-id=none"),
    libraries=("-ldl", "-lm", "-lpthread"),
)

LOOP = Program(
    "loop",
    Path(__file__).parent,
    sources=("loop.c", "guard.c", "divert.c", "effects.c"),
    headers=("control_word.h", "divert.h", "lines.h", "effects.h"),
    targets={"linux64": _LINUX},
)
