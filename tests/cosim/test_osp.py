"""libcosim's own description of a system, ``OspSystemStructure.xml``."""

import shutil

import numpy as np
import pytest
from support.linear import make_oscillator, run

from ps_fmu.cosim import Master, SystemFileError, read_system
from ps_fmu.cosim.ssp import osp

SIMULATORS = '<Simulator name="first" source="first.fmu"/>\n<Simulator name="second" source="second.fmu"/>\n'
FORCE = '<VariableConnection><Variable simulator="first" name="F"/><Variable simulator="second" name="F"/>'
MOTION = "".join(
    f'<VariableConnection powerBond="b"><Variable simulator="first" name="{name}" causality="output"/>'
    f'<Variable simulator="second" name="{name}"/></VariableConnection>\n'
    for name in ("x", "v")
)  # fmt: skip
CONNECTIONS = f"{FORCE}</VariableConnection>\n{MOTION}"
SIGNAL = '<SignalConnection><Variable simulator="{}" name="{}"/><Signal function="{}" name="{}"/></SignalConnection>'
OUT = (
    '<SignalConnection><Signal function="double" name="out"/>'
    '<Variable simulator="first" name="F"/></SignalConnection>\n'
)
DOUBLED = f"{SIGNAL.format('second', 'F', 'double', 'in')}\n{OUT}"
FUNCTIONS = '<Functions><LinearTransformation name="double" factor="2" offset="1e-3"/></Functions>\n'
HEAD = "<StartTime>1</StartTime><EndTime> 3.0 </EndTime><BaseStepSize>0.01</BaseStepSize>\n"


def text(simulators=SIMULATORS, connections=CONNECTIONS, functions="", head=HEAD, more=""):
    return (
        '<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">\n'
        f"{head}<Algorithm>fixedStep</Algorithm>\n<Simulators>\n{simulators}</Simulators>\n"
        f"{functions}<Connections>\n{connections}</Connections>{more}\n</OspSystemStructure>\n"
    )


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    """Folder with the two FMUs of the oscillator and their description in SSP."""
    folder = tmp_path_factory.mktemp("oscillator")
    make_oscillator().build(folder)
    return folder


@pytest.fixture
def read(fmus, tmp_path):
    """Reads a description that stands beside the FMUs."""

    def make(**parts):
        for name in ("first", "second"):
            shutil.copy(fmus / f"{name}.fmu", tmp_path)
        path = tmp_path / "OspSystemStructure.xml"
        path.write_text(text(**parts), encoding="utf-8")
        return read_system(path)

    return make


def test_a_system_runs_as_its_twin_in_ssp_does(read, fmus, tmp_path):
    found = read()
    twin = read_system(fmus / "SystemStructure.ssd")
    assert {str(c.source): str(c.target) for c in found.connections} == {
        "second.F": "first.F", "first.x": "second.x", "first.v": "second.v"
    }  # fmt: skip
    assert (found.experiment.start_time, found.experiment.stop_time, found.experiment.step) == (1.0, 3.0, 0.01)
    ours, theirs = run(found, "jacobi"), run(twin, "jacobi")
    for name in ours.names:
        assert np.array_equal(ours[name], theirs[name]), name
    assert read_system(tmp_path).components == found.components  # the folder means the file in it


def test_each_fmu_is_read_once_however_many_variables_it_has(read, monkeypatch):
    known, found = osp.read_description, []
    monkeypatch.setattr(
        osp, "read_description", lambda path, **options: found.append(path.name) or known(path, **options)
    )
    read()
    assert sorted(found) == ["first.fmu", "second.fmu"]


def test_linear_transformations_lie_on_the_way(read):
    found = read(connections=MOTION + DOUBLED, functions=FUNCTIONS)
    assert {(str(c.source), str(c.target)) for c in found.connections if c.hops} == {("second.F", "first.F")}
    with Master(found, 0.01) as master:
        master.initialise()
        assert master.get("first.F") == pytest.approx(2.0 * master.get("second.F") + 1e-3, rel=1e-12)
        assert abs(master.get("second.F")) > 1.0


def test_steps_start_values_and_what_the_run_does_not_follow(read):
    initial = (
        '<Simulator name="first" source="first.fmu" stepSize="0.02"><InitialValues><InitialValue variable="F">'
        '<Real value="2.5"/></InitialValue></InitialValues></Simulator>'
        '<Simulator name="second" source="second.fmu" stepSize="0"/>'
    )
    found = read(simulators=initial, connections=MOTION, head=f"{HEAD}<Description> two masses </Description>")
    assert [component.step for component in found.components] == [0.02, None]
    assert found.component("first").parameters["F"].value == 2.5
    assert found.component("first").parameters["F"].origin.endswith("OspSystemStructure.xml, line 5")
    assert found.labels["description"] == "two masses"
    assert found.remarks == ()


def test_another_algorithm_is_a_remark(read, tmp_path):
    read()
    path = tmp_path / "other.xml"
    ecco = text(more="<EccoConfiguration><StepSize>0.1</StepSize></EccoConfiguration>").replace("fixedStep", "ecco")
    path.write_text(ecco)
    (remark,) = read_system(path).remarks
    assert "other.xml, line 3: Algorithm 'ecco' is not supported" in remark


VARIABLE = '<Variable simulator="first" name="x"/>'
INITIAL = '<InitialValues><InitialValue variable="F">{}</InitialValue></InitialValues>'
GROUPS = "write a VariableConnection for each variable of the groups"
END = "</VariableConnection>"
OUTSIDE = "not a path inside the folder"


def with_value(value):
    """Simulators of which the first has this value."""
    return {"simulators": SIMULATORS.replace("/>", f">{INITIAL.format(value)}</Simulator>", 1)}


@pytest.mark.parametrize(
    ("parts", "line", "words"),
    [
        ({"simulators": ""}, 1, "has no simulators"),
        ({"simulators": SIMULATORS.replace("second", "first")}, 6, "two simulators named 'first'"),
        ({"simulators": SIMULATORS.replace("first.fmu", "../first.fmu", 1)}, 5, OUTSIDE),
        ({"simulators": SIMULATORS.replace("first.fmu", "proxyfmu://host/a.fmu", 1)}, 5, OUTSIDE),
        ({"simulators": SIMULATORS.replace("first.fmu", "third.fmu", 1)}, 5, "simulator 'first': there is no FMU"),
        ({"simulators": SIMULATORS.replace("source", "sauce", 1)}, 5, "Simulator has no attribute source"),
        ({"simulators": SIMULATORS.replace("source", 'colour="red" source', 1)}, 5, "unknown attribute 'colour'"),
        ({"simulators": SIMULATORS.replace("source", 'stepSize="-1" source', 1)}, 5, "must not be negative, got -1.0"),
        (with_value('<Real value="nan"/>'), 5, "first.F: expected a finite number, got 'nan'"),
        (with_value('<Integer value="1.5"/>'), 5, "first.F: expected a whole number, got '1.5'"),
        (with_value('<Enumeration value="red"/>'), 5, "first.F: expected a whole number, got 'red'"),
        (with_value(""), 5, "first.F: expected one value"),
        (with_value('<Complex value="1"/>'), 5, "Complex in InitialValue: is not expected here"),
        ({"head": HEAD.replace("0.01", "0")}, 1, "BaseStepSize must be a positive number"),
        ({"head": HEAD.replace("0.01", "fast")}, 2, "BaseStepSize: expected a finite number, got 'fast'"),
        ({"head": HEAD.replace(" 3.0 ", "1")}, 1, "EndTime 1.0 s is not after StartTime 1.0 s"),
        ({"head": HEAD + HEAD}, 3, "more than one StartTime"),
        ({"head": HEAD.replace("0.01", "0.01<Unit/>0")}, 2, "Unit in BaseStepSize: is not expected here"),
        ({"head": HEAD.replace("<EndTime>", '<EndTime unit="ms">')}, 2, "EndTime has an unknown attribute 'unit'"),
        ({"connections": FORCE.replace("second", "third") + END}, 9, "there is no simulator 'third'"),
        ({"connections": MOTION.replace('"x"', '"xx"', 1)}, 9, "there is no variable 'xx' in first"),
        ({"connections": MOTION.replace("second", "first")}, 9, "expected an output and an input"),
        ({"connections": FORCE.replace("first", "second") + END}, 9, "of causality output, second.F"),
        ({"connections": f"<VariableConnection>{VARIABLE}</VariableConnection>"}, 9, "expected two Variables"),
        ({"connections": f"<SignalConnection>{VARIABLE}</SignalConnection>"}, 9, "expected a Variable and a Signal"),
        ({"connections": "<VariableGroupConnection/>"}, 9, GROUPS),
        ({"connections": "<SignalGroupConnection/>"}, 9, GROUPS),
        ({"functions": '<Functions><Sum name="s" inputCount="2"/></Functions>'}, 8, "Sum in Functions: is not"),
        ({"functions": FUNCTIONS.replace('"2"', '"two"')}, 8, "factor: expected a finite number, got 'two'"),
        ({"functions": FUNCTIONS.replace("<Lin", '<LinearTransformation name="double"/><Lin')}, 8, "two functions"),
        ({"connections": DOUBLED}, 9, "there is no function 'double'"),
        ({"connections": OUT, "functions": FUNCTIONS}, 10, "input of function 'double' is not"),
        ({"connections": DOUBLED + DOUBLED, "functions": FUNCTIONS}, 12, "of function 'double' is connected twice"),
        ({"connections": SIGNAL.format("first", "F", "double", "in"), "functions": FUNCTIONS}, 10, "to an output"),
        ({"connections": SIGNAL.format("first", "x", "double", "sum"), "functions": FUNCTIONS}, 10, "signal in or"),
        ({"more": "<Observers/>"}, 12, "Observers in OspSystemStructure: is not expected here"),
        ({"head": "<Simulators/>"}, 3, "more than one Simulators"),
    ],
)
def test_what_cannot_be_honoured_is_refused_by_line(read, parts, line, words):
    with pytest.raises(SystemFileError) as caught:
        read(**parts)
    assert caught.value.path.name == "OspSystemStructure.xml"
    assert words in caught.value.text
    assert caught.value.line == line


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ("<OspSystemStructure/>", 'got OspSystemStructure of another namespace: write xmlns="http://opensimulation'),
        (text().replace("OspSystemStructure ", "System ").replace("/OspSystemStructure", "/System"), ", got System"),
        ("<project/>", "is not a system of libcosim: expected OspSystemStructure, got project"),
        (f"<!DOCTYPE a [<!ENTITY b 'c'>]>{text()}", "document type declaration"),
        (text()[:-5], "is not well-formed XML"),
        ("<a>" * 200, "nested deeper than"),
    ],
)
def test_other_files_are_refused(tmp_path, content, words):
    path = tmp_path / "pom.xml"
    path.write_text(content)
    with pytest.raises(SystemFileError, match=r"pom\.xml") as caught:
        read_system(path)
    assert words in caught.value.text


def test_values_of_the_caller_outrank_those_of_the_file(read, tmp_path):
    found = read(**with_value('<Real value="1"/>'), connections=MOTION)
    given = read_system(found.path, values=[{"first.F": found.component("first").parameters["F"]}])
    assert given.component("first").parameters["F"].value == 1.0
    with pytest.raises(SystemFileError, match="no component 'third'"):
        read_system(found.path, values=[{"third.F": found.component("first").parameters["F"]}])


def test_connections_name_their_line(read):
    assert [one.line for one in read().connections] == [9, 10, 11]
