import math

import pytest

from ps_fmu.requirements.quantity import parse_quantity


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.5 urad", "rad", 0.5e-6),
        ("0.5urad", "rad", 0.5e-6),
        (" 5e-1  urad ", "rad", 0.5e-6),
        (".1 arcsec", "rad", 0.1 * math.radians(1.0) / 3600.0),
        ("3 mas", "rad", 3e-3 * math.radians(1.0) / 3600.0),
        ("1 arcsec", "mas", 1000.0),
        ("1 mas", "uas", 1000.0),
        ("1 mas", "nrad", 4.848136811095359),
        ("1 arcmin", "deg", 1.0 / 60.0),
        ("1 deg", "arcmin", 60.0),
        ("1 mrad", "urad", 1000.0),
        ("1 urad", "nrad", 1000.0),
        ("2 mas/s", "rad/s", 2.0 * 4.848136811095359e-9),
        ("20 ms", "s", 0.02),
        ("2 um", "m", 2e-6),
        ("3 mrad/s", "rad/s", 3e-3),
        ("1 rad", "deg", math.degrees(1.0)),
        ("5 %", "1", 0.05),
        ("2 1", "", 2.0),
        ("2 1", "-", 2.0),
    ],
)
def test_values_in_other_units(text, unit, value):
    assert parse_quantity(text).to(unit) == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("0.5", "'0.5' has no unit: write for example '0.5 urad'"),
        (0.5, "with its unit as a text"),
        (True, "with its unit as a text"),
        (["0.5 urad"], "with its unit as a text"),
        ("urad", "expected a number with its unit"),
        ("", "expected a number with its unit"),
        ("1 2 urad", "the unit '2 urad' is not known"),
        ("0.5 furlong", "the unit 'furlong' is not known; known are"),
        ("0.5 arcsecs", "the unit 'arcsecs' is not known; did you mean arcsec"),
        ("0.5 mrads", "the unit 'mrads' is not known; did you mean mrad"),
        ("20 degC", "the unit 'degC' is not known"),
        ("0 urad", "expected a number above 0"),
        ("-1 urad", "expected a number above 0"),
        ("1e400 rad", "expected a number above 0"),
        ("1e-60 rad", "expected a number above 0"),
        ("nan rad", "expected a number with its unit"),
    ],
)
def test_what_is_refused(text, problem):
    with pytest.raises(ValueError) as refused:
        parse_quantity(text)
    assert problem in str(refused.value)


@pytest.mark.parametrize(("text", "unit"), [("1 urad", "m"), ("1 ms", "rad"), ("1 urad", "dB"), ("1 m", "kg.m")])
def test_units_that_do_not_fit(text, unit):
    with pytest.raises(ValueError, match=f"'{unit}'"):
        parse_quantity(text).to(unit)
