"""A parameter set as start values of the FMUs."""

from dataclasses import replace

import numpy as np
from fmpy import read_model_description

from ps_fmu.cosim.parameters import read_parameters
from ps_fmu.cosim.ssp_xml import real_values_xml
from ps_fmu.manipulator.parameters import load
from ps_fmu.scenarios.parameter_sets import differences, start_values

FMUS = {
    "plant": "ManipulatorPlant",
    "isolator": "FeedforwardIsolator",
    "commander": "PointingCommander",
    "disturbance": "DisturbanceSource",
}


def test_start_values_of_the_paper_are_those_of_the_fmus(built_fmus):
    descriptions = {name: read_model_description(built_fmus / f"{fmu}.fmu") for name, fmu in FMUS.items()}
    starts = {
        f"{component}.{variable.name}": variable.start
        for component, description in descriptions.items()
        for variable in description.modelVariables
        if variable.causality == "parameter"
    }
    for name, value in start_values(load()).items():
        assert float(starts[name]) == value if isinstance(value, float) else starts[name] == str(value).lower(), name


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
