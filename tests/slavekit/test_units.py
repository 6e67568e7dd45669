"""The grammar of unit names, and the definitions of units in an FMU."""

import math

import pytest

from ps_fmu.slavekit.author.units import BASE_UNITS, DISPLAY_UNITS, define_units, find_exponents, parse_unit


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
        ("mas", math.pi / 648e6, 0.0, {"rad": 1}),
        ("uas", math.pi / 648e9, 0.0, {"rad": 1}),
        ("\u00b5as", math.pi / 648e9, 0.0, {"rad": 1}),
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
def test_a_name_states_scale_offset_and_exponents(name, scale, offset, si):
    found = parse_unit(name)
    assert found.scale == pytest.approx(scale, rel=1e-12)
    assert found.offset == pytest.approx(offset, rel=1e-12)
    assert {base: power for base, power in zip(BASE_UNITS, found.exponents, strict=True) if power} == si


@pytest.mark.parametrize(
    "name",
    ["", "g", "Nm", "kg m", "J/kg.K", "m/(s", "m/s)", "m//s", "m2.5", "dB", "degC/m", "/s", "m\u00b2"],
)
def test_a_name_of_another_form_states_nothing(name):
    assert parse_unit(name) is None


@pytest.mark.parametrize(
    ("unit", "expected"),
    [
        ("1", {}),
        ("m", {"m": 1}),
        ("rad", {"rad": 1}),
        ("Hz", {"s": -1}),
        ("N", {"kg": 1, "m": 1, "s": -2}),
        ("N.m", {"kg": 1, "m": 2, "s": -2}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("rad/s2", {"rad": 1, "s": -2}),
        ("N/m", {"kg": 1, "s": -2}),
        ("N.s/m", {"kg": 1, "s": -1}),
        ("N.s/m2", {"kg": 1, "m": -1, "s": -1}),
        ("N2/Hz", {"kg": 2, "m": 2, "s": -3}),
        ("N2.m/Hz", {"kg": 2, "m": 3, "s": -3}),
        ("N2.m2/Hz", {"kg": 2, "m": 4, "s": -3}),
        ("N/rad2/s2", {"kg": 1, "m": 1, "s": -4, "rad": -2}),
    ],
)
def test_exponents_of_a_unit(unit, expected):
    assert find_exponents(unit) == expected


@pytest.mark.parametrize("unit", ["dB", "sqrt(kg)", "sqrt(kg).m"])
def test_units_that_fmi_cannot_state_have_no_base_unit(unit):
    assert find_exponents(unit) is None
    (element,) = define_units([unit])
    assert (element.get("name"), len(element)) == (unit, 0)


def test_display_units_state_displayed_value_per_si_value():
    (element,) = define_units(["rad"])
    factors = {child.get("name"): float(child.get("factor")) for child in element.iter("DisplayUnit")}
    assert factors == DISPLAY_UNITS["rad"]
    assert factors["deg"] == pytest.approx(180 / math.pi, rel=1e-15)
    assert factors["arcsec"] == pytest.approx(3600 * 180 / math.pi, rel=1e-15)
