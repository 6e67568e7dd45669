"""system/SystemStructure.ssd with the four FMUs: the dialect, the wiring, values that arrive."""

from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy.ssp.ssd import validate_tree
from lxml import etree
from support.cosim import simulate

from ps_fmu.cosim import Master, System, read_system

SSD = Path(__file__).parents[2] / "system" / "SystemStructure.ssd"
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
