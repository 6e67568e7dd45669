"""Names of units: what is beyond doubt is understood, everything else says nothing."""

import math

import pytest

from ps_fmu.fmucheck.unit_names import BASE_UNITS, meaning
from ps_fmu.slavekit.author.units import DISPLAY_UNITS, find_exponents


@pytest.mark.parametrize(
    ("name", "scale", "offset", "si"),
    [  # the examples of FMI 2.0.4, section 2.2.2, and others
        ("N.m", 1.0, 0.0, {"kg": 1, "m": 2, "s": -2}),
        ("N*m", 1.0, 0.0, {"kg": 1, "m": 2, "s": -2}),
        ("J", 1.0, 0.0, {"kg": 1, "m": 2, "s": -2}),
        ("bar", 1e5, 0.0, {"kg": 1, "m": -1, "s": -2}),
        ("deg", math.pi / 180.0, 0.0, {"rad": 1}),
        ("rad/s", 1.0, 0.0, {"rad": 1, "s": -1}),
        ("rpm", 0.1047197551196598, 0.0, {"rad": 1, "s": -1}),
        ("Hz", 6.283185307179586, 0.0, {"rad": 1, "s": -1}),
        ("\u00b0F", 5.0 / 9.0, 255.3722222222222, {"K": 1}),
        ("%/m", 0.01, 0.0, {"m": -1}),
        ("km", 1e3, 0.0, {"m": 1}),
        ("1", 1.0, 0.0, {}),
        ("arcsec", math.pi / 648000.0, 0.0, {"rad": 1}),
        ("urad", 1e-6, 0.0, {"rad": 1}),
        ("\u00b5rad", 1e-6, 0.0, {"rad": 1}),
        ("mm/s2", 1e-3, 0.0, {"m": 1, "s": -2}),
        ("m.s^-2", 1.0, 0.0, {"m": 1, "s": -2}),
        ("m*s**-2", 1.0, 0.0, {"m": 1, "s": -2}),
        ("J/(kg.K)", 1.0, 0.0, {"m": 2, "s": -2, "K": -1}),
        ("W/m2/K", 1.0, 0.0, {"kg": 1, "s": -3, "K": -1}),
        ("kW.h", 3.6e6, 0.0, {"kg": 1, "m": 2, "s": -2}),
        ("mm2", 1e-6, 0.0, {"m": 2}),
        ("1/min", 1.0 / 60.0, 0.0, {"s": -1}),
        ("mN.m/deg", 1e-3 * 180.0 / math.pi, 0.0, {"kg": 1, "m": 2, "s": -2, "rad": -1}),
    ],
)
def test_what_is_understood(name, scale, offset, si):
    found = meaning(name)
    assert found.scale == pytest.approx(scale, rel=1e-12)
    assert found.offset == pytest.approx(offset, rel=1e-12)
    assert {base: power for base, power in zip(BASE_UNITS, found.exponents, strict=True) if power} == si


@pytest.mark.parametrize(
    "name",
    ["", "g", "Nm", "kg m", "J/kg.K", "m/(s", "m/s)", "m//s", "m2.5", "dB", "degC/m", "/s", "m\u00b2"],
)
def test_what_says_nothing(name):
    assert meaning(name) is None


@pytest.mark.parametrize("unit", DISPLAY_UNITS)
def test_display_units_of_our_fmus(unit):
    """The factors that are written into our FMUs, by another way than they were computed."""
    own = meaning(unit)
    assert {base: power for base, power in zip(BASE_UNITS, own.exponents, strict=True) if power} == find_exponents(unit)
    for name, factor in DISPLAY_UNITS[unit].items():
        shown = meaning(name)
        assert shown.exponents == own.exponents
        assert factor == pytest.approx(own.scale / shown.scale, rel=1e-14)
    assert {"deg", "arcsec", "urad"} <= DISPLAY_UNITS["rad"].keys()
