"""What a unit's name says, where it says it beyond doubt: ``mm/s2``, ``N.m``, ``kW*h``, ``J/(kg.K)``, ``degC``.

FMI leaves the names of units to the tools (FMI 2.0.4, section 2.2.2).  Names that are written otherwise, and names
that are read in more than one way (``g`` for mass or gravity), say nothing.  A cycle is an angle of 2 pi, as in that
section; for tools to which it is none, :mod:`.unit_rules` compares only where the exponents of rad agree.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
Exponents = tuple[int, ...]
"""Of :data:`BASE_UNITS`, in that order."""
_NONE: Exponents = (0,) * len(BASE_UNITS)


@dataclass(frozen=True)
class Meaning:
    """SI value = scale * value + offset, in a coherent unit with these exponents."""

    scale: float
    exponents: Exponents
    offset: float = 0.0


def _si(**exponents: int) -> Exponents:
    return tuple(exponents.get(base, 0) for base in BASE_UNITS)


_SPEED = _si(rad=1, s=-1)
_NEWTON, _JOULE, _PASCAL = _si(kg=1, m=1, s=-2), _si(kg=1, m=2, s=-2), _si(kg=1, m=-1, s=-2)
_WITH_PREFIX = {
    "m": _si(m=1), "s": _si(s=1), "rad": _si(rad=1), "A": _si(A=1), "K": _si(K=1), "mol": _si(mol=1), "N": _NEWTON,
    "J": _JOULE, "Pa": _PASCAL, "W": _si(kg=1, m=2, s=-3), "V": _si(kg=1, m=2, s=-3, A=-1),
}  # fmt: skip
_PREFIXES = {"": 1.0, "k": 1e3, "M": 1e6, "G": 1e9, "m": 1e-3, "u": 1e-6, "\u00b5": 1e-6, "\u03bc": 1e-6, "n": 1e-9}
_DEGREE = math.radians(1.0)
_SYMBOLS = {prefix + name: (scale, si) for prefix, scale in _PREFIXES.items() for name, si in _WITH_PREFIX.items()} | {
    "1": (1.0, _NONE), "%": (1e-2, _NONE), "kg": (1.0, _si(kg=1)), "cd": (1.0, _si(cd=1)), "cm": (1e-2, _si(m=1)),
    "deg": (_DEGREE, _si(rad=1)), "\u00b0": (_DEGREE, _si(rad=1)), "arcmin": (_DEGREE / 60.0, _si(rad=1)),
    "arcsec": (_DEGREE / 3600.0, _si(rad=1)), "rev": (math.tau, _si(rad=1)), "rpm": (math.tau / 60.0, _SPEED),
    "Hz": (math.tau, _SPEED), "kHz": (1e3 * math.tau, _SPEED), "MHz": (1e6 * math.tau, _SPEED),
    "min": (60.0, _si(s=1)), "h": (3600.0, _si(s=1)), "bar": (1e5, _PASCAL),
}  # fmt: skip
_CELSIUS = Meaning(1.0, _si(K=1), 273.15)
_FAHRENHEIT = Meaning(5.0 / 9.0, _si(K=1), 273.15 - 32.0 * 5.0 / 9.0)
_WITH_OFFSET = {"degC": _CELSIUS, "\u00b0C": _CELSIUS, "degF": _FAHRENHEIT, "\u00b0F": _FAHRENHEIT}
_FACTOR = re.compile(r"([^\W\d_]+|1|%|\u00b0)(?:\^?([+-]?\d))?")


def meaning(name: str) -> Meaning | None:
    """What a unit's name says; None if it does not say it beyond doubt."""
    if name in _WITH_OFFSET:
        return _WITH_OFFSET[name]
    above, *below = re.split(r"/(?![^(]*\))", name.replace("**", "^").replace("*", "."))
    result = _product(above)
    for divisor in below:
        grouped = divisor.startswith("(") and divisor.endswith(")")
        other = _product(divisor[1:-1] if grouped else divisor)
        if result is None or other is None or ("." in divisor and not grouped):
            return None
        exponents = tuple(a - b for a, b in zip(result.exponents, other.exponents, strict=True))
        result = Meaning(result.scale / other.scale, exponents)
    return result


def _product(text: str) -> Meaning | None:
    scale, exponents = 1.0, _NONE
    for part in text.split("."):
        factor = _FACTOR.fullmatch(part)
        if factor is None or factor[1] not in _SYMBOLS:
            return None
        power = int(factor[2] or 1)
        own, si = _SYMBOLS[factor[1]]
        scale *= own**power
        exponents = tuple(a + power * b for a, b in zip(exponents, si, strict=True))
    return Meaning(scale, exponents)
