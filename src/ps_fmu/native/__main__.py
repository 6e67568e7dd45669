"""Compile all: ``make launcher``."""

import sys

from .build import CompileError, make_all

try:
    make_all()
except CompileError as error:
    sys.exit(str(error))
