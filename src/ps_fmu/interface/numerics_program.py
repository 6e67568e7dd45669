"""What the library of :mod:`ps_fmu.numerics` is compiled from.  As a program: compile it.

It is here because the physics does not know how FMUs and their programs are made.
"""

from __future__ import annotations

import sys
from pathlib import Path

from ..slavekit.launcher.c_program import CompileError, Program, Target

_HEADERS = (
    "numerics.h", "arithmetic.h", "tables.h", "random.h", "keyed.h", "errors.h", "transform.h", "turning.h",
    "calls.h", "../processor.h",
    *(f"../slavekit/launcher/{name}" for name in ("kernel.h", "core.h", "elements.h", "product.h")),
)  # fmt: skip
_KERNEL = tuple(f"../slavekit/launcher/{name}" for name in ("kernel.c", "elements.c", "timed.c"))
_COMMON = ("-O3", "-fno-math-errno", "-shared", "-s", "-Wl,--build-id=none")


def _linux(zig: str) -> Target:
    return Target(zig, "numerics.so", (*_COMMON, "-fPIC", "-fvisibility=hidden"), ("-lm",))


NUMERICS = Program(
    "numerics",
    Path(__file__).parents[1] / "numerics",
    sources=("numerics.c", "sse2.c", "avx2.c", "avx512.c", *_KERNEL),
    headers=_HEADERS,
    targets={
        "linux64": _linux("x86_64-linux-gnu.2.17"),
        "aarch64-linux": _linux("aarch64-linux-gnu.2.17"),
        "win64": Target("x86_64-windows-gnu", "numerics.dll", _COMMON),
    },
)
"""The library, for the platforms that the launcher is made for.

:meta hide-value:
"""

if __name__ == "__main__":
    try:
        NUMERICS.make()
    except CompileError as error:
        sys.exit(str(error))
