"""The systems, parameters and faults of system/: they fit the FMUs, their values arrive, they do what they say."""

import json
import re
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import jsonschema
import numpy as np
import pytest
from fmpy.ssp.ssd import validate_tree
from lxml import etree
from scipy.signal import lfilter
from support.cosim import simulate
from support.faults import write
from support.linear import run
from support.models import load_script

from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.cosim import Master, System, read_parameters, read_system
from ps_fmu.cosim.faults.reading import SCHEMA
from ps_fmu.cosim.schemes.scheme import Rate, Scheme
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import list_entries

ROOT = Path(__file__).parents[2]
SYSTEM = ROOT / "system"
SSD = SYSTEM / "SystemStructure.ssd"
NAMESPACES = {
    "ssd": "http://ssp-standard.org/SSP1/SystemStructureDescription",
    "ssc": "http://ssp-standard.org/SSP1/SystemStructureCommon",
}


@pytest.fixture(scope="module")
def system(built_fmus: Path) -> System:
    """The system of this project."""
    return read_system(SSD, built_fmus)


def test_the_file_keeps_to_the_dialect_that_all_tools_load():
    """SSP 1.0 by its schema, the usual prefixes, no comments among the elements, connected ports only, each once."""
    text = SSD.read_text(encoding="utf-8")
    validate_tree(etree.fromstring(text.encode()), "SystemStructureDescription.xsd")
    root = ElementTree.fromstring(text)
    assert text.count("<ssd:Connection ") == 21
    assert "<!--" not in text
    assert 'xmlns="' not in text
    connected = set()
    for connection in root.iterfind(".//ssd:Connection", NAMESPACES):
        get = connection.attrib.__getitem__
        connected |= {(get(f"{end}Element"), get(f"{end}Connector")) for end in ("start", "end")}
    declared = []
    for component in root.iterfind(".//ssd:Component", NAMESPACES):
        assert {"name", "type", "implementation", "source"} <= set(component.keys())
        for connector in component.iterfind(".//ssd:Connector", NAMESPACES):
            declared.append((component.get("name"), connector.get("name")))
            real = connector.find("ssc:Real", NAMESPACES)
            assert real is not None
            assert real.get("unit")
    assert sorted(declared) == sorted(connected)


def test_the_wiring_fits_the_fmus(system):
    master = Master(system)
    assert (master.clock.start, master.step, system.experiment.stop_time) == (0.0, 1e-4, 20.0)
    assert {str(item.port) for item in master.open_inputs} == {
        "commander.target.roll",
        "commander.target.pitch",
        "commander.target.yaw",
        "isolator.enabled",
        *(f"plant.added_fine_force_{i}" for i in (1, 2, 3)),
        *(f"plant.payload_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"),
        *(
            f"plant.prescribed_{motion}.{axis}"
            for motion in ("acceleration", "angular_velocity", "angular_acceleration")
            for axis in "xyz"
        ),
    }
    assert master.wiring.loops == ()
    assert master.wiring.stepping == ("disturbance", "commander", "plant", "isolator")
    assert {column.unit for column in master.columns if column.name.startswith("plant.base_acc")} == {"m/s2"}


def test_the_order_of_the_components_does_not_matter(system):
    """Jacobi sees only the last communication point; and each FMU runs its own code in any order of loading."""
    forward = simulate(system, end=0.05)
    backward = simulate(replace(system, components=system.components[::-1]), end=0.05)
    assert sorted(forward.names) == sorted(backward.names)
    assert np.ptp(forward["plant.payload_rotation.x"]) > 0.0
    for name in forward.names:
        np.testing.assert_array_equal(backward[name], forward[name], err_msg=name)


def test_parameters_and_inputs_arrive(system):
    changed = system.with_parameters({"plant.payload.mass": 40, "isolator.enabled": False})
    with Master(changed) as master:
        master.initialise()
        assert master.get("plant.payload.mass") == 40.0
        assert master.get("isolator.enabled") is False
        master.run(0.01, events=[(0.005, "commander.target.roll", 0.01)])
        assert master.get("commander.target.roll") == 0.01
        assert master.get("commander.moving") is True
        assert master.get("isolator.fine_force_1") == 0.0


STEP = 1e-4  # s


@pytest.fixture(scope="module")
def coils(built_fmus) -> System:
    return read_system(SYSTEM / "VoiceCoils.ssd", built_fmus)


def test_the_wiring_of_the_coils_fits_the_fmus(coils):
    master = Master(coils)
    assert master.wiring.loops == ()
    assert len(coils.connections) == 30
    open_inputs = {str(item.port) for item in master.open_inputs if str(item.port).startswith("coils")}
    assert open_inputs == {f"coils.added_force_command_{i}" for i in (1, 2, 3)}


def test_ideal_coils_are_a_delay_of_one_step(coils, built_fmus):
    """The default system with one step of delay in its isolator."""
    ideal = dict(read_parameters(ROOT / "system" / "parameters" / "coils_ideal.ssv"))
    found = simulate(coils.with_parameters(ideal), STEP, 0.2)
    default = read_system(SSD, built_fmus)
    expected = simulate(default.with_parameters({"isolator.delay": STEP}), STEP, 0.2)
    for name in [f"plant.payload_rotation.{axis}" for axis in "xyz"]:
        size = np.abs(expected[name]).max()
        np.testing.assert_allclose(found[name], expected[name], rtol=0.0, atol=1e-9 * size)
    np.testing.assert_allclose(
        found["coils.fine_force_2"][1:], found["isolator.fine_force_2"][:-1], rtol=1e-9, atol=1e-12
    )


def test_default_coils_follow_the_isolator(coils):
    """The demand through the pole of the current loop, and what resolution and noise add to it."""
    found, driver = simulate(coils, STEP, 1.0), Coils.from_parameters(load()).driver
    pole = np.exp(-2.0 * np.pi * driver.bandwidth * STEP)
    variance = driver.current_resolution**2 / 12.0 + driver.noise**2 / (2.0 * STEP)  # A2
    for i in (1, 2, 3):
        demand = found[f"isolator.fine_force_{i}"]
        followed = lfilter([0.0, 1.0 - pole], [1.0, -pole], demand)
        error = found[f"coils.fine_force_{i}"] - followed
        assert np.sqrt(np.mean(demand**2)) > 5.0 * np.sqrt(np.mean(error**2))
        assert np.var(error) == pytest.approx(3.9**2 * variance * (1.0 - pole) / (1.0 + pole), rel=0.2)
        assert 0.0 < found[f"coils.power_{i}"].max() < 1.0  # W
    assert not found["coils.saturated"].any()
    assert found["coils.contacts"][-1] == 0.0


def test_a_payload_that_is_pushed_meets_the_stops(coils):
    """A wrench on the payload for 30 ms: the stops hold the legs, take energy, and the motion dies down."""
    quiet = {"disturbance.noise.enabled": False, "isolator.enabled": False}
    pushed = coils.with_parameters(quiet | {"plant.payload_force.x": 200.0, "plant.payload_force.z": 400.0})
    found = simulate(pushed, STEP, 1.0, events=[(0.03, f"plant.payload_force.{axis}", 0.0) for axis in "xz"])
    displacement = np.abs([found[f"plant.fine_displacement_{i}"] for i in (1, 2, 3)]).max(axis=0)
    assert found["coils.contacts"][-1] >= 2.0
    assert (np.diff(found["coils.contacts"]) >= 0.0).all()
    assert 2e-3 < displacement.max() < 4e-3
    assert displacement[-2000:].max() < displacement.max()
    touching = found["coils.contact"].astype(bool)
    pushes = np.abs([found[f"coils.stop_force_{i}"] for i in (1, 2, 3)]).max(axis=0) > 0.0
    np.testing.assert_array_equal(touching, pushes)


FILES = sorted((SYSTEM / "parameters").glob("*.ssv"))


SYSTEMS = [SSD, *sorted(SYSTEM.glob("*.ssd"))]


def find_system(given, built_fmus):
    """The default system, or another one that has the components that are given values."""
    wanted = {name.partition(".")[0] for name in given}
    systems = (read_system(path, built_fmus) for path in SYSTEMS)
    return next(system for system in systems if wanted <= {component.name for component in system.components})


def of_bus(name):
    """Parameters of a bus in paper.toml: the plant's, and where the disturbance acts."""
    bus = load(bus=name).bus
    values = {f"plant.{entry.name}": entry.value for entry in list_entries(bus, "bus")}
    return values | {f"disturbance.bus.com.{axis}": value for axis, value in zip("xyz", bus.com_B, strict=True)}


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_values_arrive_in_the_fmus(path, built_fmus):
    """Every value of the file; and one at least is not what the FMUs start with, but for the two that say just that."""
    validate_tree(etree.parse(path).getroot(), "SystemStructureParameterValues.xsd")
    given = read_parameters(path)
    system = find_system(given, built_fmus)
    with Master(system) as master:
        master.initialise()
        before = {name: master.get(name) for name in given}
    with Master(system.with_parameters(given)) as master:
        master.initialise()
        after = {name: master.get(name) for name in given}
    assert after == dict(given)
    assert (after == before) == (path.stem in ("OSM", "sensors_seismic"))


@pytest.mark.parametrize("name", ["OSM", "LSM"])
def test_buses_are_those_of_the_parameter_set(name):
    assert dict(read_parameters(SYSTEM / "parameters" / f"{name}.ssv")) == of_bus(name)


def test_exact_payload_is_that_of_the_plant():
    com = {f"isolator.payload.com.{axis}": value for axis, value in zip("xyz", load().payload.com_P, strict=True)}
    assert dict(read_parameters(SYSTEM / "parameters" / "exact_payload.ssv")) == com


def test_units_are_stated():
    for path in FILES:
        given = read_parameters(path)
        stated = {name for name, entry in given.entries().items() if entry.unit}
        assert {name for name, value in given.items() if isinstance(value, float)} == stated


def test_orientations_are_those_of_table_2():
    files = {path.stem: read_parameters(path) for path in FILES if path.stem.startswith("orientation_")}
    found = {
        stem: tuple(np.degrees(given[f"commander.target.{angle}"]).round(12) for angle in ("roll", "pitch", "yaw"))
        for stem, given in files.items()
    }
    assert found == {
        "orientation_roll_8p5": (8.5, 0.0, 0.0),
        "orientation_pitch_minus_7": (0.0, -7.0, 0.0),
        "orientation_yaw_14": (0.0, 0.0, 14.0),
    }


def test_the_readme_names_each_file_and_no_other():
    """One row of the table, or more, for each file; files are named as they are, without *."""
    text = (SYSTEM / "parameters" / "README.md").read_text(encoding="utf-8")
    rows = [line.split("|")[1] for line in text.splitlines() if line.startswith("| `")]
    named = [name for row in rows for name in re.findall(r"`([\w.]+)`", row)]
    there = [path.name for path in (SYSTEM / "parameters").iterdir() if path.suffix in (".ssv", ".toml", ".csv")]
    assert sorted(named) == sorted(there)


FAULTS = sorted((SYSTEM / "faults").glob("*.json"))
LEAST = {"accelerometer_fails": (3.0, 15.0), "voice_coil_sticks": (15.0, 15.0), "tracker_loses_lock": (5.0, 40.0)}
"""So many times as large as without the fault is the RMS during the first fault, at least; its end [s]."""


@pytest.fixture(scope="module")
def drawing():
    return load_script(ROOT / "docs" / "draw_faults.py")


@pytest.mark.parametrize("path", FAULTS, ids=lambda path: path.stem)
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
    rows = run(read_system(SSD, built_fmus), scheme, 1e-3, 0.06, faults=faults)
    off = rows["isolator.enabled"] == 0.0
    own = scheme.get_rate("isolator").steps  # rows show what it has done
    assert np.flatnonzero(off).tolist() == list(range(20 + own, 40 + own))
    force = np.abs([rows[f"isolator.fine_force_{leg}"] for leg in (1, 2, 3)]).max(axis=0)
    assert not force[24:41].any() and (force[10:20] > 0.0).all() and (force[45:] > 0.0).all()


def test_all_of_them_are_tried():
    assert {path.stem for path in FAULTS} == LEAST.keys()
