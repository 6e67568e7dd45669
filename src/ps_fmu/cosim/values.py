"""Values as XML writes them (XML Schema Part 2): Real, Integer and Boolean."""

from __future__ import annotations

import math
import re

Value = float | int | bool | str
"""What a variable may have: Real, Integer (and the number of an item of an Enumeration), Boolean or String."""

_REAL = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?")
_INTEGER = re.compile(r"[+-]?\d+")
_BOOLEAN = {"true": True, "1": True, "false": False, "0": False}
MOST_DIGITS = 300
"""Of a whole number that is read: it is out of range anyway, and thousands take long."""
EXPECTED = {"Real": "a finite number", "Integer": "a whole number", "Boolean": "true or false"}


def parse_real(text: str) -> float | None:
    """A finite decimal number, or None."""
    stripped = text.strip()
    value = float(stripped) if _REAL.fullmatch(stripped) else math.nan
    return value if math.isfinite(value) else None


def parse_value(kind: str, text: str) -> Value | None:
    """A value of an FMI type (Real, Integer, Boolean or String), or None for a text that is none."""
    stripped = text.strip()
    if kind == "Real":
        return parse_real(text)
    if kind == "Integer":
        return int(stripped) if _INTEGER.fullmatch(stripped) and len(stripped) <= MOST_DIGITS else None
    if kind == "Boolean":
        return _BOOLEAN.get(stripped)
    return text


def fits_int32(value: int) -> bool:
    """Whether a whole number is one of FMI 2.0, which has 32 bits."""
    return -(2**31) <= value < 2**31
