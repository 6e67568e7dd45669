"""The grammar of unit names, and the unit definitions of an FMU (FMI 2.0.4, section 2.2.2).

FMI leaves the names of units to the tools.  :func:`parse_unit` reads the usual forms: factors joined by ``.`` or ``*``,
each divisor behind its own ``/``, powers as digits: ``kg.m2``, ``N.s/m``, ``mm/s^2``, ``J/(kg.K)``, ``degC``.

Variables of a slave have coherent SI units only, so that no tool ever has to convert a value.  Units that FMI cannot
express get a definition without base units: logarithms (``dB``) and roots such as ``sqrt(kg).m``, the participation of
a mass-normalised mode, because FMI's exponents are whole numbers.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from xml.etree.ElementTree import Element, SubElement

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""The attributes of FMI's ``BaseUnit``, in the order of its schema."""

Exponents = tuple[int, ...]
"""Of :data:`BASE_UNITS`, in that order."""


@dataclass(frozen=True)
class Unit:
    """SI value = scale * value + offset, in a coherent unit with these exponents."""

    scale: float
    exponents: Exponents
    offset: float = 0.0


def _si(**exponents: int) -> Exponents:
    return tuple(exponents.get(base, 0) for base in BASE_UNITS)


_NONE, _SPEED, _PER_SECOND = _si(), _si(rad=1, s=-1), _si(s=-1)
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
    "arcsec": (_DEGREE / 3600.0, _si(rad=1)), "mas": (_DEGREE / 3.6e6, _si(rad=1)),
    "uas": (_DEGREE / 3.6e9, _si(rad=1)), "\u00b5as": (_DEGREE / 3.6e9, _si(rad=1)),
    "rev": (math.tau, _si(rad=1)), "rpm": (math.tau / 60.0, _SPEED),
    "Hz": (math.tau, _SPEED), "kHz": (1e3 * math.tau, _SPEED), "MHz": (1e6 * math.tau, _SPEED),
    "min": (60.0, _si(s=1)), "h": (3600.0, _si(s=1)), "bar": (1e5, _PASCAL),
}  # fmt: skip
SYMBOLS = (*_SYMBOLS,)
"""Names of the units that :func:`parse_unit` knows as factors, those of temperatures apart."""
_EVENTS = _SYMBOLS | {"Hz": (1.0, _PER_SECOND), "kHz": (1e3, _PER_SECOND), "MHz": (1e6, _PER_SECOND)}
_CELSIUS = Unit(1.0, _si(K=1), 273.15)
_FAHRENHEIT = Unit(5.0 / 9.0, _si(K=1), 273.15 - 32.0 * 5.0 / 9.0)
_WITH_OFFSET = {"degC": _CELSIUS, "\u00b0C": _CELSIUS, "degF": _FAHRENHEIT, "\u00b0F": _FAHRENHEIT}
_IMBALANCES = {
    f"g.{length}{power}": Unit(1e-3 * scale**int(power or 1), _si(kg=1, m=int(power or 1)))
    for length, scale in (("cm", 1e-2), ("mm", 1e-3), ("m", 1.0))
    for power in ("", "2")
}
"""Of wheels: with a length, g is a gram."""
_FACTOR = re.compile(r"([^\W\d_]+|1|%|\u00b0)(?:\^?([+-]?\d))?")
_LONGEST = 100  # characters of a name that is parsed: the time grows with their square
_WITHOUT_BASE = re.compile(r"dB|.*\bsqrt\(.*")
_PLAIN = re.compile(r"[A-Za-z0-9./]*")

_DISPLAYED_AS = {
    "rad": ("deg", "arcsec", "mrad", "urad"),
    "rad/s": ("deg/s", "rpm"),
    "rad/s2": ("deg/s2",),
    "m": ("mm", "um"),
    "s": ("ms",),
    "N": ("mN",),
    "kg.m": ("g.cm",),
    "kg.m2": ("g.cm2",),
}


def parse_unit(name: str, *, cycle_is_angle: bool = True) -> Unit | None:
    """What the name of a unit says; None where it is written otherwise or can be read in more than one way.

    Parameters
    ----------
    name: such as ``mm/s2``.  ``g`` (mass or gravity) and ``m/s.K`` (what is below the line?) have two meanings.
    cycle_is_angle: True: Hz is 2 pi rad/s, as in FMI 2.0.4, section 2.2.2.  False: Hz is 1/s, as in spectral densities.
    """
    if name in _WITH_OFFSET:
        return _WITH_OFFSET[name]
    if name in _IMBALANCES:
        return _IMBALANCES[name]
    if len(name) > _LONGEST:
        return None
    symbols = _SYMBOLS if cycle_is_angle else _EVENTS
    above, *below = re.split(r"/(?![^(]*\))", name.replace("**", "^").replace("*", "."))
    result = _parse_product(above, symbols)
    for divisor in below:
        grouped = divisor.startswith("(") and divisor.endswith(")")
        other = _parse_product(divisor[1:-1] if grouped else divisor, symbols)
        if result is None or other is None or ("." in divisor and not grouped):
            return None
        exponents = tuple(a - b for a, b in zip(result.exponents, other.exponents, strict=True))
        result = Unit(result.scale / other.scale, exponents)
    return result


def _parse_product(text: str, symbols: dict[str, tuple[float, Exponents]]) -> Unit | None:
    scale, exponents = 1.0, _NONE
    for part in text.split("."):
        factor = _FACTOR.fullmatch(part)
        if factor is None or factor[1] not in symbols:
            return None
        power = int(factor[2] or 1)
        own, si = symbols[factor[1]]
        scale *= own**power
        exponents = tuple(a + power * b for a, b in zip(exponents, si, strict=True))
    return Unit(scale, exponents)


def find_exponents(unit: str) -> dict[str, int] | None:
    """SI exponents of a coherent unit, without zeros; None where FMI has no way to state them (``dB``, roots).

    Raises ValueError if the unit is not known or not coherent.
    """
    if _WITHOUT_BASE.fullmatch(unit):
        return None
    parsed = parse_unit(unit, cycle_is_angle=False) if _PLAIN.fullmatch(unit) else None
    if parsed is None or (parsed.scale, parsed.offset) != (1.0, 0.0):
        raise ValueError(
            f"unit {unit!r}: expected SI units without prefix, joined by '.' and '/', for example 'N.s/m' or 'kg.m2'\n"
            f"  ({', '.join(BASE_UNITS)}, N, Pa, J, W, V, Hz, 1)"
        )
    return {base: power for base, power in zip(BASE_UNITS, parsed.exponents, strict=True) if power}


def _find_factor(unit: str, display_unit: str) -> float:
    own, shown = parse_unit(unit), parse_unit(display_unit)
    assert own is not None and shown is not None and own.exponents == shown.exponents
    return own.scale / shown.scale


DISPLAY_UNITS = {
    unit: {shown: _find_factor(unit, shown) for shown in displayed} for unit, displayed in _DISPLAYED_AS.items()
}
"""Display units of each unit and their factor: displayed value = factor * value."""


def define_units(units: list[str]) -> Element:
    """The ``UnitDefinitions`` element for these units, in the given order."""
    definitions = Element("UnitDefinitions")
    for unit in units:
        element = SubElement(definitions, "Unit", name=unit)
        powers = find_exponents(unit)
        if powers is not None:
            SubElement(element, "BaseUnit", {base: str(power) for base, power in powers.items()})
        for name, factor in DISPLAY_UNITS.get(unit, {}).items():
            SubElement(element, "DisplayUnit", name=name, factor=repr(factor))
    return definitions
