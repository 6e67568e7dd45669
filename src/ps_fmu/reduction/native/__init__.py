"""The reduction in C: ``python -m ps_fmu.cosim.native`` makes the library, too."""

from __future__ import annotations

from pathlib import Path

from ...slavekit.launcher.c_program import Program, Target

_FLAGS = ("-D_GNU_SOURCE", "-fPIC", "-fvisibility=hidden", "-shared", "-s", "-Wl,--build-id=none")

REDUCTION = Program(
    "reduction",
    Path(__file__).parent,
    sources=("columns.c", "filter.c", "histogram.c", "moments.c"),
    headers=("filter.h", "../../processor.h"),
    targets={
        "linux64": Target("x86_64-linux-gnu.2.17", "reduction.so", _FLAGS),
        "aarch64-linux": Target("aarch64-linux-gnu.2.17", "reduction.so", _FLAGS),
    },
)
