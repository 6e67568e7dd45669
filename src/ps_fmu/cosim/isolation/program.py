"""What the processes of isolated FMUs run, compiled: ``python -m ps_fmu.cosim.native`` makes it, too."""

from __future__ import annotations

from pathlib import Path

from ...slavekit.launcher.c_program import Program, Target

_LINUX = Target(
    "x86_64-linux-gnu.2.17",
    "isolation.so",
    ("-D_GNU_SOURCE", "-fPIC", "-fvisibility=hidden", "-shared", "-s", "-Wl,--build-id=none"),
    libraries=("-ldl", "-lm", "-lpthread"),
)

ISOLATION = Program(
    "isolation",
    Path(__file__).parent,
    sources=("client.c", "later.c", "guest.c"),
    headers=("channel.h", "client.h", "waiting.h", "../native/control_word.h"),
    targets={"linux64": _LINUX},
)
"""The library that the master and the processes of the FMUs load.

:meta hide-value:
"""
