"""Ports, units and their XML."""

import math

import pytest

from ps_fmu.slavekit.author.variables import Port, make_fmi_variable, numbered, vector


@pytest.mark.parametrize("unit", ["", "furlong", "deg", "m s", "m^2", "m/", "2m", "N*m"])
def test_unknown_units_are_refused_with_the_ports_name(unit):
    with pytest.raises(ValueError, match=r"port force\.x: unit"):
        Port("force.x", "input", unit)


def test_vector_and_numbered_names():
    assert [p.name for p in vector("force", "xyz", "N", "Force in B", causality="input")] == [
        "force.x",
        "force.y",
        "force.z",
    ]
    ports = numbered("leg", 2, "m", "Length", causality="parameter", start=(1.0, 2.0), min=0)
    assert [(p.name, p.start, p.min, p.description) for p in ports] == [
        ("leg_1", 1.0, 0, "Length, 1"),
        ("leg_2", 2.0, 0, "Length, 2"),
    ]
    with pytest.raises(ValueError, match="leg_1: start: expected 2 values, got 3"):
        numbered("leg", 2, "m", "Length", causality="parameter", start=(1.0, 2.0, 3.0))


@pytest.mark.parametrize(
    ("attributes", "problem"),
    [
        ({"name": "a[1]", "causality": "input"}, "identifiers"),
        ({"name": "a..b", "causality": "input"}, "identifiers"),
        ({"name": "a", "causality": "independent"}, "causality"),
        ({"name": "a", "causality": "input", "start": math.nan}, "finite"),
        ({"name": "a", "causality": "input", "start": 3.0, "max": 2.0}, "at most 2"),
        ({"name": "a", "causality": "parameter", "start": "x"}, "number"),
        ({"name": "a", "causality": "parameter", "type": "Integer", "start": 1.5}, "whole number"),
        ({"name": "a", "causality": "parameter", "type": "Integer", "start": 2**31}, "32 bits"),
        ({"name": "a", "causality": "parameter", "type": "Boolean", "start": 2}, "true or false"),
        ({"name": "a", "causality": "parameter", "type": "Boolean", "unit": "m"}, "unit"),
        ({"name": "a", "causality": "parameter", "type": "String", "max": 1.0}, "max"),
        ({"name": "a", "causality": "parameter", "max": math.inf}, "max"),
        ({"name": "a", "causality": "output", "type": "String"}, "String outputs"),
        ({"name": "a", "causality": "output", "event": True}, "events"),
        ({"name": "a", "causality": "input", "depends_on": ("b",)}, "dependencies"),
        ({"name": "a", "causality": "input", "unit": "m", "display_unit": "deg"}, "display unit"),
    ],
)
def test_contradictory_ports_are_refused(attributes, problem):
    with pytest.raises(ValueError, match=f"{attributes['name'].split('[')[0]}.*{problem}"):
        Port(**attributes)


def test_inputs_that_are_not_real_are_events():
    assert Port("a", "input", type="Boolean").event
    assert not Port("a", "input").event


def test_xml_of_a_real_parameter_has_all_digits():
    port = Port("a.b", "parameter", "rad", "Text", start=0.1 + 0.2, min=-1, max=2, nominal=0.5, display_unit="deg")
    element = make_fmi_variable(port, 7).to_xml()
    assert element.attrib == {
        "name": "a.b",
        "valueReference": "7",
        "description": "Text",
        "causality": "parameter",
        "variability": "fixed",
        "initial": "exact",
    }
    assert element[0].tag == "Real"
    assert element[0].attrib == {
        "unit": "rad",
        "displayUnit": "deg",
        "min": "-1.0",
        "max": "2.0",
        "nominal": "0.5",
        "start": "0.30000000000000004",
    }


@pytest.mark.parametrize(
    ("port", "variability", "initial", "inner"),
    [
        (Port("a", "input"), "continuous", None, {"unit": "1", "start": "0.0"}),
        (Port("a", "output"), "continuous", "calculated", {"unit": "1"}),
        (Port("a", "output", type="Boolean"), "discrete", "calculated", {}),
        (Port("a", "input", type="Boolean", start=True), "discrete", None, {"start": "true"}),
        (Port("a", "parameter", type="Integer", start=3.0, max=9), "fixed", "exact", {"start": "3", "max": "9"}),
        (Port("a", "parameter", type="String"), "fixed", "exact", {"start": ""}),
    ],
)
def test_variability_and_initial_are_explicit_where_the_standard_has_them(port, variability, initial, inner):
    element = make_fmi_variable(port, 0).to_xml()
    assert element.get("variability") == variability
    assert element.get("initial") == initial
    assert element[0].tag == port.type
    assert element[0].attrib == inner
