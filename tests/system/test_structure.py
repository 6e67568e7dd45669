"""system/SystemStructure.ssd with the four FMUs: the dialect, the wiring, the schemes, another importer."""

import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import validate_tree
from lxml import etree
from support.cosim import Collect

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


def simulate(system: System, duration: float, scheme: str = "jacobi") -> dict[str, np.ndarray]:
    """All columns of a run, by name."""
    collect = Collect()
    with Master(system, scheme=scheme) as master:
        master.initialise()
        master.run(duration, [collect])
        return {column.name: values for column, values in zip(master.columns, collect.values.T, strict=True)}


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
    forward = simulate(system, 0.05)
    backward = simulate(replace(system, components=system.components[::-1]), 0.05)
    assert forward.keys() == backward.keys()
    assert np.ptp(forward["plant.payload_rotation.x"]) > 0.0
    for name, values in forward.items():
        np.testing.assert_array_equal(backward[name], values, err_msg=name)


def test_gauss_seidel_is_close_to_jacobi(system):
    jacobi, gauss_seidel = (simulate(system, 0.2, scheme) for scheme in ("jacobi", "gauss-seidel"))
    for name in ("plant.base_position.x", "plant.base_rotation.y"):
        scale = np.abs(jacobi[name]).max()
        np.testing.assert_allclose(gauss_seidel[name], jacobi[name], atol=0.01 * scale, err_msg=name)
    assert not np.array_equal(gauss_seidel["plant.payload_rotation.x"], jacobi["plant.payload_rotation.x"])


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


def test_fmpy_steps_the_same_system_to_the_same_numbers(system, built_fmus, tmp_path):
    """FMPy labels its rows one step early, and starts from zero inputs; so does this system, at rest."""
    path = tmp_path / "system.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.write(SSD, "SystemStructure.ssd")
        for component in system.components:
            archive.write(component.source, f"resources/{component.source.name}")
    ours = simulate(read_system(path), 0.03)
    theirs = simulate_ssp(str(path), stop_time=0.03 - 0.5e-4, step_size=1e-4)
    assert len(theirs) == 300
    for name in theirs.dtype.names[1:]:
        if name in ours:
            np.testing.assert_array_equal(theirs[name], ours[name][1:], err_msg=name)
    assert np.ptp(ours["isolator.fine_force_1"]) > 0.0
