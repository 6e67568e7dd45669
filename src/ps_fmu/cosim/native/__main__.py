"""Compile the loop, and what isolated FMUs run in."""

from __future__ import annotations

import sys

from ...slavekit.launcher.c_program import CompileError
from ..isolation.program import ISOLATION
from . import LOOP

try:
    LOOP.make()
    ISOLATION.make()
except CompileError as error:
    sys.exit(str(error))
