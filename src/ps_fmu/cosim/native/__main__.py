"""Compile the loop, what isolated FMUs run in, and the reduction of recorded rows."""

from __future__ import annotations

import sys

from ...reduction.native import REDUCTION
from ...slavekit.launcher.c_program import CompileError
from ..isolation.guest_process import ISOLATION
from . import LOOP

try:
    LOOP.make()
    ISOLATION.make()
    REDUCTION.make()
except CompileError as error:
    sys.exit(str(error))
