"""Compile the loop, what isolated FMUs run in, and the passes over blocks of rows."""

from __future__ import annotations

import sys

from ...blocks.native import BLOCKS
from ...slavekit.launcher.c_program import CompileError
from ..isolation.program import ISOLATION
from . import LOOP

try:
    LOOP.make()
    ISOLATION.make()
    BLOCKS.make()
except CompileError as error:
    sys.exit(str(error))
