"""Connections of each type, and what they do to a value on its way: transformations, units, enumerations."""

import re

import numpy as np
import pytest
from support.relays import LINEAR, NAMES, TABLE, description, make_chain, port, relay, system, wire

from ps_fmu.cosim import Master, WiringError

H = 0.1


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize("name", NAMES)
def test_each_type_is_carried(open_text, collect, name, scheme):
    value = {"real": 2.5, "level": -1.5, "whole": 42, "flag": True, "text": "words, \u00e4"}[name]
    with Master(open_text(make_chain("", name)), H, scheme) as master:
        master.set(f"a.{name}_in", value)
        master.initialise()
        assert master.get(f"b.{name}_out") == value  # carried before the first step
        master.run(2 * H)
        assert master.get(f"b.{name}_in") == value


def test_strings_change_during_a_run(open_text):
    with Master(open_text(make_chain("", "text")), H) as master:
        master.initialise()
        master.run(2 * H, events=[(H, "a.text_in", "later")])
        assert master.get("a.text_in") == "later"
        master.run(H)
        assert master.get("b.text_in") == "later"


INVERTED = (
    '<ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/>'
    '<ssc:MapEntry source="0" target="1"/></ssc:BooleanMappingTransformation>'
)
COLOURS = (
    '<ssc:EnumerationMappingTransformation><ssc:MapEntry source="red" target="gruen"/>'
    '<ssc:MapEntry source="blue" target="blau"/></ssc:EnumerationMappingTransformation>'
)


@pytest.mark.parametrize("scheme", ["jacobi", "gauss-seidel"])
@pytest.mark.parametrize(
    ("name", "inside", "given", "expected", "fmus"),
    [
        ("real", LINEAR, 1.5, 6.0, ()),
        ("real", '<ssc:LinearTransformation offset="-1"/>', 1.5, 0.5, ()),
        ("flag", INVERTED, True, False, ()),
        ("flag", INVERTED, False, True, ()),
        ("whole", TABLE, 1, 2, ()),
        ("whole", TABLE, 2, 9, ()),
        ("whole", TABLE, 5, 5, ()),
        ("whole", COLOURS, 1, 20, ("English.fmu", "German.fmu")),
        ("whole", COLOURS, 3, 30, ("English.fmu", "German.fmu")),
        ("whole", "", 2, 2, ("English.fmu", "ToyRelay.fmu")),
    ],
)
def test_transformations(open_text, name, inside, given, expected, fmus, scheme):
    with Master(open_text(make_chain(inside, name, *fmus)), H, scheme) as master:
        master.set(f"a.{name}_in", given)
        master.initialise()
        assert master.get(f"b.{name}_in") == expected
        master.run(2 * H)
        assert master.get(f"b.{name}_in") == expected


@pytest.mark.parametrize(
    ("fmus", "inside", "attributes", "expected"),
    [
        (("Metre.fmu", "Milli.fmu"), "", {}, 2000.0),
        (("Milli.fmu", "Metre.fmu"), "", {}, 0.002),
        (("Kelvin.fmu", "Celsius.fmu"), "", {}, 2.0 - 273.15),
        (("Celsius.fmu", "Kelvin.fmu"), "", {}, 275.15),
        (("Metre.fmu", "ToyRelay.fmu"), "", {}, 2.0),  # it states none
        (("Metre.fmu", "Milli.fmu"), LINEAR, {}, 4003.0),  # first the units, then the transformation
        (("Metre.fmu", "Milli.fmu"), LINEAR, {"suppressUnitConversion": "true"}, 7.0),
        (("Metre.fmu", "Milli.fmu"), "", {"suppressUnitConversion": "1"}, 2.0),
    ],
)
def test_units_are_converted(open_text, fmus, inside, attributes, expected):
    with Master(open_text(make_chain(inside, "real", *fmus, **attributes)), H) as master:
        master.set("a.real_in", 2.0)
        master.initialise()
        master.run(2 * H)
        assert master.get("b.real_in") == pytest.approx(expected, rel=1e-15)


def test_units_on_the_way_through_a_system(open_text):
    """Metre to a connector in mm, times 2, to one without a unit, plus 3, to metre."""
    innermost = system(
        relay("r", source="Metre.fmu"), wire("z", "r/real_in", LINEAR.replace('"2"', '"1"')), port("z", "input")
    )
    inner = system(
        f'<ssd:System name="t">{innermost}</ssd:System>',
        wire("x", "t/z", LINEAR.replace('"3"', '"0"')),
        port("x", "input", '<ssc:Real unit="mm"/>'),
    )
    outer = system(
        f'{relay("a", source="Metre.fmu")}<ssd:System name="s">{inner}</ssd:System>', wire("a/real_out", "s/x")
    )
    with Master(open_text(description(outer)), H) as master:
        master.set("a.real_in", 5.0)
        master.initialise()
        # 5 m = 5000 mm; the connector without a unit has that of the next one, so 5 m again; twice; plus 3.
        assert master.get("s.t.r.real_in") == pytest.approx(2.0 * 5.0 + 3.0, rel=1e-15)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (make_chain("", "real", "Metre.fmu", "Second.fmu"), "differ in their dimensions, 'm' and 's'"),
        (make_chain(LINEAR, "whole"), "a transformation for Linear values cannot act on Integer"),
        (make_chain(TABLE, "real"), "a transformation for Integer values cannot act on Real"),
        (make_chain(INVERTED.replace('"true"', '"0"'), "flag"), "the source value '0' occurs twice"),
        (make_chain(TABLE.replace('"9"', '"x"'), "whole"), "expected a whole number, got 'x'"),
        (make_chain(COLOURS.replace("blau", "grau"), "whole", "English.fmu", "German.fmu"),
         "no item 'grau' in the enumeration; expected one of rot"),
    ],
)
def test_conversions_that_cannot_be_honoured(open_text, text, reason):
    with pytest.raises(WiringError, match=re.escape(reason)) as caught:
        Master(open_text(text), H)
    line = text[: text.index("<ssd:Connection ")].count("\n") + 1
    assert caught.value.problems[0].startswith(f"line {line}: connection a.")


def test_what_is_stored_equals_what_the_fmus_hold(open_text, collect):
    """The columns of connected Integers and Booleans behind tables, against the values in the FMU."""
    both = relay("a") + relay("b")
    wires = wire("a/whole_out", "b/whole_in", TABLE) + wire("a/flag_out", "b/flag_in", INVERTED)
    with Master(open_text(description(system(both, wires))), H) as master:
        master.initialise()
        master.run(4 * H, [collect], events=[(2 * H, "a.whole_in", 2), (2 * H, "a.flag_in", True)])
        places = {column.name: place for place, column in enumerate(master.columns)}
        assert collect.values[:, places["b.whole_out"]].tolist() == [2.0, 2.0, 2.0, 2.0, 9.0]
        assert collect.values[:, places["b.flag_out"]].tolist() == [1.0, 1.0, 1.0, 1.0, 0.0]
        assert np.isfinite(collect.values).all()
