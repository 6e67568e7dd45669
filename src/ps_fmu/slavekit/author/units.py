"""Units of FMI variables: SI exponents and display units from a unit's name (FMI 2.0.4, section 2.2.2).

A unit's name is its definition: factors joined by ``.``, each divisor behind its own ``/``, exponents as
plain digits: ``kg.m2``, ``N.s/m``, ``N2.m2/Hz``.  All units are coherent SI, so that no tool ever has to
convert a value.

Units that FMI cannot express get a definition without base units: logarithms (``dB``) and roots such as
``sqrt(kg).m``, the participation of a mass-normalised mode, because FMI's exponents are whole numbers.
"""

from __future__ import annotations

import math
import re
from xml.etree.ElementTree import Element, SubElement

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""The attributes of FMI's ``BaseUnit``, in the order of its schema."""

_SYMBOLS: dict[str, dict[str, int]] = {name: {name: 1} for name in BASE_UNITS} | {
    "1": {},
    "Hz": {"s": -1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Pa": {"kg": 1, "m": -1, "s": -2},
    "J": {"kg": 1, "m": 2, "s": -2},
    "W": {"kg": 1, "m": 2, "s": -3},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
}
_WITHOUT_BASE = re.compile(r"dB|.*\bsqrt\(.*")
_FACTOR = re.compile(r"([A-Za-z]+|1)(\d*)")

_DEGREES = {"deg": math.degrees(1.0)}
DISPLAY_UNITS: dict[str, dict[str, float]] = {
    "rad": _DEGREES | {"arcsec": math.degrees(3600.0), "mrad": 1e3, "urad": 1e6},
    "rad/s": {"deg/s": math.degrees(1.0), "rpm": 30.0 / math.pi},
    "rad/s2": {"deg/s2": math.degrees(1.0)},
    "m": {"mm": 1e3, "um": 1e6},
    "s": {"ms": 1e3},
    "N": {"mN": 1e3},
}
"""Display units of each unit and their factor: displayed value = factor * value."""


def exponents(unit: str) -> dict[str, int] | None:
    """SI exponents of a unit, without zeros; None where FMI has no way to state them (``dB``, roots).

    Raises ValueError if the unit is not known or not written as this module expects.
    """
    if _WITHOUT_BASE.fullmatch(unit):
        return None
    total = dict.fromkeys(BASE_UNITS, 0)
    sign = 1
    for part in re.split(r"([./])", unit):
        if part in (".", "/"):
            sign = -1 if part == "/" else 1
            continue
        factor = _FACTOR.fullmatch(part)
        if factor is None or factor[1] not in _SYMBOLS:
            raise ValueError(
                f"unit {unit!r} is not known: expected {', '.join(_SYMBOLS)}, joined by '.' and '/', "
                "for example 'N.s/m' or 'kg.m2'"
            )
        for base, exponent in _SYMBOLS[factor[1]].items():
            total[base] += sign * exponent * int(factor[2] or 1)
    return {base: exponent for base, exponent in total.items() if exponent}


def unit_definitions(units: list[str]) -> Element:
    """The ``UnitDefinitions`` element for these units, in the given order."""
    definitions = Element("UnitDefinitions")
    for unit in units:
        element = SubElement(definitions, "Unit", name=unit)
        powers = exponents(unit)
        if powers is not None:
            SubElement(element, "BaseUnit", {base: str(power) for base, power in powers.items()})
        for name, factor in DISPLAY_UNITS.get(unit, {}).items():
            SubElement(element, "DisplayUnit", name=name, factor=repr(factor))
    return definitions
