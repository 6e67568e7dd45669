"""Compile the loop."""

from __future__ import annotations

import sys

from ...slavekit.launcher.c_program import CompileError
from . import LOOP

try:
    LOOP.make()
except CompileError as error:
    sys.exit(str(error))
