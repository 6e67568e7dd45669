"""system/parameters: each file is valid, and its values arrive in the FMUs."""

import re
from pathlib import Path

import numpy as np
import pytest
from fmpy.ssp.ssd import validate_tree
from lxml import etree

from ps_fmu.cosim import Master, read_parameters, read_system
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import list_entries

SYSTEM = Path(__file__).parents[2] / "system"
FILES = sorted((SYSTEM / "parameters").glob("*.ssv"))


SYSTEMS = [SYSTEM / "SystemStructure.ssd", *sorted(SYSTEM.glob("*.ssd"))]


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
        assert {name for name, value in given.items() if isinstance(value, float)} == set(given.units)


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
    there = [path.name for path in (SYSTEM / "parameters").iterdir() if path.suffix in (".ssv", ".toml")]
    assert sorted(named) == sorted(there)
