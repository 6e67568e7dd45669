"""modelDescription.xml: complete, consistent, the same every time."""

from xml.etree.ElementTree import tostring

import pytest

from ps_fmu.slavekit.author.slave import Port, Slave, vector


@pytest.fixture(scope="module")
def root(toys):
    return toys["oscillator"](instance_name="o").to_xml()


def names(root, tag, attribute):
    variables = [variable.get("name") for variable in root.iter("ScalarVariable")]
    return {
        variables[int(u.get("index")) - 1]: u.get(attribute) for u in root.iterfind(f"ModelStructure/{tag}/Unknown")
    }


def test_attributes_of_the_root(root):
    assert root.get("modelName") == "Oscillator"
    assert root.get("description") == "A mass on a spring"
    assert root.get("variableNamingConvention") == "structured"
    for attribute in ("author", "license", "copyright", "version", "guid", "generationTool"):
        assert root.get(attribute)
    assert root.get("generationTool").startswith("ps_fmu ")
    assert root.get("generationDateAndTime") == "2023-02-08T00:00:00Z"


def test_order_of_the_elements_is_that_of_the_schema(root):
    assert [child.tag for child in root] == [
        "CoSimulation",
        "UnitDefinitions",
        "LogCategories",
        "DefaultExperiment",
        "ModelVariables",
        "ModelStructure",
    ]


def test_capabilities(root):
    flags = root.find("CoSimulation").attrib
    assert flags["modelIdentifier"] == "Oscillator"
    true = {name for name, value in flags.items() if value == "true"}
    assert true == {
        "needsExecutionTool",
        "canHandleVariableCommunicationStepSize",
        "canGetAndSetFMUstate",
        "canSerializeFMUstate",
        "canNotUseMemoryManagementFunctions",
    }


def test_variables_are_all_ports_in_their_order_with_references_into_the_buffer(root, toys):
    layout = toys["oscillator"].layout
    found = [(v.get("name"), int(v.get("valueReference"))) for v in root.iter("ScalarVariable")]
    assert found == [(port.name, layout.find(port.name)) for port in layout.ports]


def test_each_unit_is_defined_once(root):
    defined = [unit.get("name") for unit in root.iter("Unit")]
    used = {real.get("unit") for real in root.iter("Real")}
    assert len(defined) == len(set(defined))
    assert set(defined) == used


def test_states_and_their_rates_come_last_and_provide_derivatives(toys):
    root = toys["circuit"](instance_name="c").to_xml()
    assert root.find("CoSimulation").get("providesDirectionalDerivative") == "true"
    variables = [(v.get("name"), v.get("causality"), v[0].get("derivative")) for v in root.iter("ScalarVariable")]
    assert variables[-4:] == [
        ("x[1]", "local", None), ("x[2]", "local", None), ("der(x[1])", "local", "5"), ("der(x[2])", "local", "6"),
    ]  # fmt: skip
    assert set(names(root, "Derivatives", "dependencies")) == {"der(x[1])", "der(x[2])"}
    assert {"charge", "x[1]", "der(x[2])"} <= set(names(root, "InitialUnknowns", "dependencies"))


def test_structure_of_latched_outputs(root):
    assert names(root, "Outputs", "dependencies") == {"position": "", "speed": "", "engaged": ""}
    assert names(root, "InitialUnknowns", "dependencies") == {"position": None, "speed": None, "engaged": None}


def test_dependencies_are_ascending_places():
    class Feedthrough(Slave):
        ports = (
            *vector("u", "xyz", "N", "Input", causality="input"),
            Port("y", "output", "N", depends_on=("u.z", "u.x"), initially_depends_on=("k", "u.y")),
            Port("k", "parameter"),
            Port("z", "output", "N", initially_depends_on=()),
        )

    root = Feedthrough(instance_name="f").to_xml()
    assert names(root, "Outputs", "dependencies") == {"y": "1 3", "z": ""}
    assert names(root, "InitialUnknowns", "dependencies") == {"y": "2 5", "z": ""}


def test_a_slave_without_outputs_has_an_empty_structure():
    class Sink(Slave):
        ports = (Port("u", "input"),)

    assert len(Sink(instance_name="s").to_xml().find("ModelStructure")) == 0


def test_the_same_class_gives_the_same_text(toys, monkeypatch):
    first, second = (tostring(toys["oscillator"](instance_name=name).to_xml()) for name in "ab")
    assert first == second
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    dated = toys["oscillator"](instance_name="o").to_xml()
    assert dated.get("generationDateAndTime") == "1970-01-02T00:00:00Z"
