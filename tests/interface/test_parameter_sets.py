"""A parameter set as start values of the FMUs."""

from dataclasses import replace

import numpy as np
from fmpy import read_model_description
from support.models import COMPONENTS

from ps_fmu.cosim import System
from ps_fmu.cosim.ssp.parameters import read_parameters
from ps_fmu.cosim.ssp.writing import real_values_xml
from ps_fmu.cosim.structure import Component
from ps_fmu.interface.parameter_sets import build_plant_and_isolator, differences, list_departures, start_values
from ps_fmu.mechanism.parameters import load
from ps_fmu.theory.loop import loop_at, loop_of


def test_start_values_of_the_paper_are_those_of_the_fmus(built_fmus):
    descriptions = {name: read_model_description(built_fmus / f"{fmu}.fmu") for name, fmu in COMPONENTS.items()}
    starts = {
        f"{component}.{variable.name}": variable.start
        for component, description in descriptions.items()
        for variable in description.modelVariables
        if variable.causality == "parameter"
    }
    for name, value in start_values(load()).items():
        assert float(starts[name]) == value if isinstance(value, float) else starts[name] == str(value).lower(), name


def test_the_way_back(tmp_path):
    """Plant and isolator of the start values of another set are those of the set; nothing else is told apart."""
    p = load()
    legs = tuple(replace(leg, stiffness=1.3 * leg.stiffness) for leg in p.manipulator.fine_legs)
    other = replace(
        p,
        manipulator=replace(p.manipulator, fine_legs=legs),
        payload=replace(p.payload, mass=1.1 * p.payload.mass),
        filters=replace(p.filters, lowpass_order=7),
        known_com_P=p.payload.com_P,
    )
    system = System(
        tmp_path, tuple(Component(name, tmp_path, (), {}, 0) for name in COMPONENTS), ()
    ).with_parameters(differences(other))
    found = loop_of(*build_plant_and_isolator(system), (0.1, 0.0, 0.0), 0.02)
    expected = loop_at(other, (0.1, 0.0, 0.0), 0.02)
    s = 2j * np.pi * np.array([1.0, 5.0, 50.0])
    np.testing.assert_array_equal(found.transfer(s), expected.transfer(s))
    assert not np.allclose(found.transfer(s), loop_at(p, (0.1, 0.0, 0.0), 0.02).transfer(s))


def test_what_is_not_of_the_paper():
    given = start_values(load()) | {"commander.target.roll": 0.1, "isolator.enabled": False, "isolator.delay": 0.0}
    assert list_departures(given) == []
    assert list_departures(given | {"isolator.delay": 0.02, "plant.payload.mass": 1.0}) == [
        "plant.payload.mass",
        "isolator.delay",
    ]


def test_only_what_differs_is_said_and_read_back(tmp_path):
    p = load()
    assert differences(p) == {}
    other = replace(p, payload=replace(p.payload, com_P=p.payload.com_P + np.array([0.0, 1e-3, 0.0])))  # m
    assert differences(other) == {"plant.payload.com.y": p.payload.com_P[1] + 1e-3}
    told = replace(p, known_com_P=np.array([0.1, p.known_com_P[1], p.known_com_P[2]]))
    assert differences(told) == {"isolator.payload.com.x": 0.1}
    path = tmp_path / "other.ssv"
    path.write_bytes(real_values_xml(differences(other) | differences(told)))
    assert dict(read_parameters(path)) == differences(other) | differences(told)
