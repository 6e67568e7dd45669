"""The files of faults that ps_fmu ships: they fit their systems and the schema, and do what docs/faults.md says."""

import importlib.util
import json
from pathlib import Path

import jsonschema
import numpy as np
import pytest
from support.faults import write
from support.linear import run

from ps_fmu.cosim import read_system
from ps_fmu.cosim.faults.reading import SCHEMA
from ps_fmu.cosim.schemes.scheme import Rate, Scheme

ROOT = Path(__file__).parents[2]
FILES = sorted((ROOT / "system" / "faults").glob("*.json"))
LEAST = {"accelerometer_fails": (3.0, 15.0), "voice_coil_sticks": (15.0, 15.0), "tracker_loses_lock": (5.0, 40.0)}
"""So many times as large as without the fault is the RMS during the first fault, at least; its end [s]."""


@pytest.fixture(scope="module")
def drawing():
    spec = importlib.util.spec_from_file_location("draw_faults", ROOT / "docs" / "draw_faults.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_it_fits_the_schema(path):
    jsonschema.validate(json.loads(path.read_text()), json.loads(SCHEMA.read_text()))


@pytest.mark.parametrize("name", LEAST)
def test_it_makes_the_pointing_error_larger_while_it_acts(drawing, built_fmus, name):
    least, end = LEAST[name]
    (time, healthy, none), (_, faulty, acted) = (drawing.simulate(name, 1e-3, f, end) for f in (False, True))
    assert not none and acted[0].until_s == end
    before, during = time <= acted[0].from_s, (time >= acted[0].from_s) & (time <= acted[0].until_s)
    assert np.array_equal(healthy[before], faulty[before])
    assert drawing.find_rms(faulty[during]) > least * drawing.find_rms(healthy[during])


SCHEMES = [Scheme("gauss-seidel"), Scheme("iterated", "linear"), Scheme(rates={"isolator": Rate(4)})]


@pytest.mark.parametrize("scheme", SCHEMES, ids=str)
def test_what_is_switched_during_a_run_is_an_input_that_faults_act_on(built_fmus, tmp_path, scheme):
    """Our parameters are fixed.  The isolator is switched off for 20 ms, though nothing is connected to its switch."""
    event = {"time": 0.02, "duration": 0.02, "model": "isolator", "variable": "enabled"}
    faults = write(tmp_path, {**event, "action": "override", "value": False})
    rows = run(read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus), scheme, 1e-3, 0.06, faults=faults)
    off = rows["isolator.enabled"] == 0.0
    own = scheme.get_rate("isolator").steps  # rows show what it has done
    assert np.flatnonzero(off).tolist() == list(range(20 + own, 40 + own))
    force = np.abs([rows[f"isolator.fine_force_{leg}"] for leg in (1, 2, 3)]).max(axis=0)
    assert not force[24:41].any() and (force[10:20] > 0.0).all() and (force[45:] > 0.0).all()


def test_all_of_them_are_tried():
    assert {path.stem for path in FILES} == LEAST.keys()
