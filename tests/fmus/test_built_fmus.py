"""The FMU files: checkers, FMPy alone, memory, load orders, bytes of a second build, what fmus/README.md says."""

import gc
import hashlib
import os
import re
import subprocess
import sys
import weakref
import xml.etree.ElementTree as ET
import zipfile
from itertools import pairwise
from pathlib import Path

import fmpy
import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.fmi1 import FMICallException
from lxml import etree
from support.host import unpack
from support.importers import IMPORTERS, interpreter_with
from support.jobs import HOSTS
from support.models import MODELS, Host
from support.twins import InFmpy

from ps_fmu.cosim import read_system, write_ssp
from ps_fmu.slavekit.author.slave import Refused
from ps_fmu.slavekit.pack.build import build_one

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "fmus" / "README.md").read_text(encoding="utf-8")
SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"


@pytest.fixture(params=MODELS)
def fmu(request, built_fmus) -> Path:
    return built_fmus / f"{request.param}.fmu"


def test_fmutool_check_finds_nothing(fmu: Path) -> None:
    command = [sys.executable, "-m", "fmu_manipulation_toolbox.cli.fmutool", "-input", str(fmu), "-check"]
    result = subprocess.run(command, capture_output=True, text=True, timeout=300)
    text = result.stdout + result.stderr
    assert result.returncode == 0, text
    assert "No semantic error against the FMI-2 standard." in text


@pytest.mark.parametrize("times", [{}, {"sample_time": 0.002}, {"delay": 0.002}, {"latency": 0.002}], ids=str)
def test_an_input_that_jumps_between_steps_runs_under_simulate_fmu(fmu: Path, times: dict) -> None:
    """Each FMU alone.  FMPy ends a step where an input jumps, and goes on from there to the next output."""
    variables = read_model_description(fmu).modelVariables
    if not times.keys() <= {variable.name for variable in variables}:
        return
    inputs = [variable.name for variable in variables if variable.causality == "input" and variable.type == "Real"]
    signals = None
    if inputs:
        name = inputs[0]
        start = next(float(variable.start) for variable in variables if variable.name == name)
        rows = [(0.0, start), (0.01234567, start), (0.01234567, start + 1e-6), (1.0, start + 1e-6)]
        signals = np.array(rows, dtype=[("time", float), (name, float)])
    result = simulate_fmu(str(fmu), stop_time=0.05, output_interval=1e-3, input=signals, start_values=times)
    assert result["time"][-1] == pytest.approx(0.05)
    for name in result.dtype.names[1:]:
        assert np.isfinite(result[name].astype(float)).all(), name


def test_input_signals_reach_the_plant(built_fmus) -> None:
    """A force on the bus, given as FMPy's input table, moves it as Newton says."""
    signals = np.array([(0.0, 913.0), (1.0, 913.0)], dtype=[("time", float), ("base_force.z", float)])
    result = simulate_fmu(
        str(built_fmus / "ManipulatorPlant.fmu"),
        stop_time=0.5,
        output_interval=1e-3,
        input=signals,
        output=["base_acceleration.z", "base_position.z"],
    )
    # The flexible modes share the force in turn; the mean acceleration is force over mass.
    assert result["base_position.z"][-1] == pytest.approx(0.5 * 913.0 / 9148.0 * 0.5**2, rel=0.15)


@pytest.mark.parametrize("signals", [None, np.array([(0.0, 1.0)], dtype=[("time", float), ("base_force.x", float)])])
def test_a_refused_step_ends_simulate_fmu(built_fmus, capfd, signals) -> None:
    """FMPy repeats a step that is answered fmi2Discard, with the same inputs, and never gives up."""
    with pytest.raises(FMICallException, match=r"fmi2DoStep failed with status 3 \(error\)"):
        simulate_fmu(
            str(built_fmus / "ManipulatorPlant.fmu"),
            start_values={"servo.frequency": 1e49},  # Hz
            input=signals,
            stop_time=0.01,
            timeout=300,
        )
    assert capfd.readouterr().err.splitlines() == [
        "ManipulatorPlant 'ManipulatorPlant': step from t = 0 s refused: the step leads to a singular pose "
        "of the legs, or to numbers that are not finite; far beyond what is usual: servo.frequency = 1e+49 Hz"
    ]


def test_start_values_reach_the_fmu(built_fmus) -> None:
    path = str(built_fmus / "PointingCommander.fmu")
    result = simulate_fmu(path, stop_time=0.01, output_interval=1e-3, start_values={"target.roll": 0.1})
    assert result["orientation_command.roll"][-1] == 0.1


def test_load_orders_in_one_process_give_the_same(built_fmus) -> None:
    files = [str(built_fmus / f"{name}.fmu") for name in MODELS]
    script = Path(__file__).parent / "hosts" / "load_orders.py"
    result = subprocess.run([sys.executable, str(script), *files], capture_output=True, text=True, timeout=300)
    assert result.returncode == 0, result.stdout + result.stderr
    lines = result.stdout.splitlines()
    assert [line.split()[-1] for line in lines] == len(files) * ["same"]
    after = {pair for line in lines for pair in pairwise(line.split()[:-1])}
    assert len(after) == len(files) * (len(files) - 1)


def test_instances_leave_next_to_nothing_behind(built_fmus, tmp_path) -> None:
    """The native library never releases what it reads of a class: of the class itself 24 blocks of memory."""
    one = InFmpy(unpack(built_fmus / "PointingCommander.fmu", tmp_path / "commander"))
    one.free()
    fmu = one.fmu

    def count(instances: int) -> int:
        for _ in range(instances):
            fmu.instantiate()
            fmu.fmi2FreeInstance(fmu.component)
        gc.collect()
        return sys.getallocatedblocks()

    before = count(10)
    assert (count(40) - before) / 40 < 10
    fmu.freeLibrary()


@pytest.mark.parametrize("model", ["DisturbanceSource", "ManipulatorPlant"])
def test_second_build_has_the_same_bytes(built_fmus: Path, tmp_path: Path, model: str) -> None:
    """With a compiled library inside, and without."""
    again = build_one(ROOT / "fmus" / MODELS[model], tmp_path).read_bytes()
    assert hashlib.sha256(again).digest() == hashlib.sha256((built_fmus / f"{model}.fmu").read_bytes()).digest()


def test_description_is_complete(fmu: Path) -> None:
    """What tools ask for beyond the schema: units and descriptions everywhere, initial unknowns, all outputs.

    States of a linear model are numbers of a vector: they have no unit.
    """
    root = ET.fromstring(zipfile.ZipFile(fmu).read("modelDescription.xml"))
    units = {unit.get("name") for unit in root.iter("Unit")}
    variables = root.findall("ModelVariables/ScalarVariable")
    for variable in variables:
        assert variable.get("description"), variable.get("name")
        real = variable.find("Real")
        if real is not None and variable.get("causality") != "local":
            assert real.get("unit") in units, variable.get("name")
        if variable.get("causality") == "input":
            assert variable.get("initial") is None
    outputs = [i for i, v in enumerate(variables, 1) if v.get("causality") == "output"]
    states = [i for i, v in enumerate(variables, 1) if v.get("causality") == "local"]
    for part, expected in (("Outputs", outputs), ("InitialUnknowns", outputs + states)):
        listed = [int(unknown.get("index")) for unknown in root.findall(f"ModelStructure/{part}/Unknown")]
        assert listed == expected
    assert root.find("CoSimulation").get("canGetAndSetFMUstate") == "true"
    assert root.find("CoSimulation").get("canSerializeFMUstate") == "true"


def test_quantities_have_magnitudes_and_bounds(fmu: Path) -> None:
    """Real inputs and outputs have nominal values; what cannot be negative has a minimum."""
    for variable in read_model_description(str(fmu)).modelVariables:
        if variable.type != "Real":
            continue
        if variable.causality in ("input", "output"):
            assert float(variable.nominal) > 0.0, variable.name
        elif variable.name.rpartition(".")[2] in ("mass", "stiffness", "damping", "damping_ratio", "frequency"):
            assert float(variable.min) >= 0.0, variable.name


def test_an_icon_and_what_is_to_read(fmu: Path) -> None:
    with zipfile.ZipFile(fmu) as archive:
        names = set(archive.namelist())
        icon = archive.read("model.png")
        index = archive.read("documentation/licenses/license.txt").decode()
        page = archive.read("documentation/index.html").decode()
        needed = archive.read("documentation/externalDependencies.txt").decode()
    assert icon == (ROOT / "fmus" / MODELS[fmu.stem] / "icon.png").read_bytes()
    assert icon.startswith(b"\x89PNG")
    assert "CPython 3.11 or later with numpy.\n" in needed  # scipy would make a bundle twice as large
    assert {f"documentation/{link}" for link in re.findall(r'href="([^"#]+)"', page)} <= names
    others = {name for name in names if name.startswith("documentation/licenses/") and "license.txt" not in name}
    listed = {line.partition(":")[0] for line in index.partition("-----")[0].splitlines()[2:] if line}
    assert {f"documentation/licenses/{name}" for name in listed} == others
    if fmu.stem == "DisturbanceSource":
        assert "wheel-harmonics.txt" in listed


def list_wires(system: str, fmus: Path) -> set[tuple[tuple[str, str], ...]]:
    """The connections of a system, each as the FMU and the variable that it comes from and goes to."""
    found = read_system(ROOT / "system" / system, fmus)
    models = {component.name: component.source.stem for component in found.components}
    return {
        tuple((models[port.component], port.variable) for port in (connection.source, connection.target))
        for connection in found.connections
    }


def test_joining_terminals_of_one_name_wires_what_the_page_says(built_fmus) -> None:
    """The published system, and the sensor of the line of sight with plant and controller."""
    schema = etree.XMLSchema(etree.parse(str(SCHEMA)))
    members: dict[str, dict[str, list[str]]] = {}
    causality: dict[tuple[str, str], str] = {}
    for model in MODELS:
        path = built_fmus / f"{model}.fmu"
        archive = zipfile.ZipFile(path)
        if "terminalsAndIcons/terminalsAndIcons.xml" not in archive.namelist():
            continue
        root = etree.fromstring(archive.read("terminalsAndIcons/terminalsAndIcons.xml"))
        schema.assertValid(root)
        for terminal in root.iterfind("Terminals/Terminal"):
            found = {m.get("memberName"): m.get("variableName") for m in terminal}
            members.setdefault(terminal.get("name"), {})[model] = found
        causality |= {(model, v.name): v.causality for v in read_model_description(str(path)).modelVariables}
    (said,) = re.findall(r"^\*\*Terminals\.\*\*.*?^$", PAGE, re.DOTALL | re.MULTILINE)
    assert set(re.findall(r"`(\w+)`", said)) == set(members)
    joined = set()
    for name, pair in members.items():
        assert len(pair) == 2, name
        (one, ones), (other, others) = pair.items()
        assert set(ones) == set(others)  # the rule "plug"
        for member, variable in ones.items():
            ends = [(one, variable), (other, others[member])]
            start, end = sorted(ends, key=lambda end: causality[end] != "output")
            assert (causality[start], causality[end]) == ("output", "input")
            joined.add((start, end))
    sighted = {
        wire for wire in list_wires("LineOfSight.ssd", built_fmus) if "LineOfSightSensor" in (wire[0][0], wire[1][0])
    }
    assert joined == list_wires("SystemStructure.ssd", built_fmus) | sighted


def test_outputs_follow_inputs_in_initialisation_mode_where_the_page_says_so(fmu: Path, tmp_path: Path) -> None:
    """Each Real input is set to another number, each Boolean one to the other value."""
    one = InFmpy(unpack(fmu, tmp_path / "fmu"))
    one.fmu.setupExperiment(startTime=0.0)
    one.fmu.enterInitializationMode()
    before = one.outputs()
    for variable in one.inputs:
        if variable.type == "Real":
            one.set({variable.name: float(variable.start) + 0.01})
        else:
            (value,) = one.fmu.getBoolean([variable.valueReference])
            one.set({variable.name: not value})
    follows = one.outputs() != before
    one.free()
    (said,) = re.findall(r"In\s+initialisation\s+mode[^.]*?follow\s", PAGE)
    assert follows == (fmu.stem in said)


def test_ports_of_the_design(built_fmus) -> None:
    """Names that other simulators are wired by; changing one breaks them."""
    wanted = {
        "ManipulatorPlant": "fine_force_1 coarse_command_3 base_force.x base_torque.z base_acceleration.x "
        "base_angular_acceleration.z base_position.y base_rotation.x payload_rotation.z payload_position.x "
        "fine_displacement_2 coarse_displacement_1 orientation.roll orientation.pitch orientation.yaw los.x los.y",
        "PointingCommander": "target.roll target.pitch target.yaw coarse_command_1 orientation_command.yaw "
        "platform_position.z reachable residual",
        "FeedforwardIsolator": "base_acceleration.x base_angular_acceleration.y orientation.roll enabled "
        "fine_force_3 saturated",
        "DisturbanceSource": "base_force.x base_force.y base_force.z base_torque.x base_torque.y base_torque.z",
        "InertialSensors": "base_acceleration.x base_angular_acceleration.y base_angular_velocity.z channel_12 "
        "estimated_acceleration.x estimated_angular_acceleration.z estimated_angular_velocity.x saturated",
    }
    for name, ports in wanted.items():
        description = read_model_description(str(built_fmus / f"{name}.fmu"))
        assert set(ports.split()) <= {v.name for v in description.modelVariables}, name


SETTINGS = [
    ("manipulator_plant", {}),
    ("pointing_commander", {"target__roll": 0.1}),  # slews, with an event in each step
    ("feedforward_isolator", {}),
    ("feedforward_isolator", {"sample_time": 2e-4, "delay": 3e-4, "force_limit": 0.05}),
    ("disturbance_source", {}),
    ("disturbance_source", {"noise__multisine": True}),
    ("inertial_sensors", {"sample_time": 2e-4, "latency": 3e-4}),
]
H = 1e-4  # s


@pytest.fixture
def no_collection():
    """Only what nobody refers to goes, as soon as nobody does."""
    gc.collect()
    gc.disable()
    yield
    gc.enable()


@pytest.mark.parametrize(("folder", "start"), SETTINGS)
def test_slaves_are_in_no_cycle(folder, start, no_collection):
    host = Host(folder, **start).run_mode()
    host.step(H, 20)
    state = host.save()
    host.step(H, 5)
    with pytest.raises(Refused):
        host.slave.do_step(-1.0, H)
    host.restore(state, 20)
    host.step(H, 20)
    slave, memory = weakref.ref(host.slave), weakref.ref(host.slave._buffer.data.base)
    del host
    assert slave() is None
    assert memory() is None


@pytest.mark.parametrize("model", MODELS)
def test_a_freed_instance_is_gone(model, built_fmus, tmp_path, no_collection):
    """Pythonfmu's library counts references wrongly where there was an exception, and guard.py against that."""
    folder = unpack(built_fmus / f"{model}.fmu", tmp_path / model)
    names = ("to be freed", "this one, too")
    fmus = [InFmpy(folder, name).fmu for name in names]
    for fmu in fmus:
        for call in (fmu.reset, fmu.setupExperiment, fmu.enterInitializationMode, fmu.exitInitializationMode):
            call()
        for i in range(20):
            fmu.doStep(i * H, H)
    content = fmus[0].serializeFMUstate(state := fmus[0].getFMUstate())
    fmus[0].setFMUstate(fmus[0].deSerializeFMUstate(content))
    for mistake in (
        lambda: fmus[0].deSerializeFMUstate(content[:-1]),
        lambda: fmus[0].setFMUstate(None),
        lambda: fmus[1].setFMUstate(state),
        lambda: fmus[0].getReal([999_999]),
        lambda: fmus[1].setReal([0], [np.nan]),
        lambda: fmus[1].doStep(-1.0, H),
        fmus[0].enterInitializationMode,
    ):
        with pytest.raises(FMICallException):
            mistake()
    (script,) = (folder / "resources").glob(f"ps_fmu_*/{MODELS[model]}_*.py")
    slaves = getattr(sys.modules[f"{script.parent.name}.{script.stem}"], model).instances

    def alive():
        return sorted(slave.instance_name for slave in slaves if slave.instance_name in names)

    assert alive() == sorted(names)
    for fmu in fmus:
        fmu.freeInstance()
    assert alive() == []


ROWS = [
    [cell.strip() for cell in line.strip("| ").split("|")]
    for line in PAGE.partition("### Where they were run")[2].partition("\n### ")[0].splitlines()
    if line.startswith("| ") and not line.startswith("| Tool")
]


def recipe(tool: str) -> str:
    """The Python code below the tool's heading."""
    section = PAGE.partition(f"\n### {tool}\n")[2].partition("\n### ")[0]
    return section.partition("```python\n")[2].partition("```")[0]


def test_the_table_says_what_the_tests_run():
    """Each tool in the list is asked for by a test, or else the list would promise too much."""
    assert {row[0] for row in ROWS if row[2] == "tests"} == {*IMPORTERS, "C host"}
    assert {row[2] for row in ROWS} == {"tests", "by hand", "not run"}
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests" / "system").glob("test_*.py"))
    assert "interpreter_with(" in tests
    assert [name for name in IMPORTERS if f'"{name}"' not in tests] == []


def test_the_table_names_the_releases_that_are_installed_for_the_tests():
    pins = (ROOT / "constraints.txt").read_text(encoding="utf-8") + (ROOT / "Makefile").read_text(encoding="utf-8")
    for name, version, *_ in (row for row in ROWS if row[0] in IMPORTERS):
        package, release = version.split()
        assert package == IMPORTERS[name].package
        assert re.search(rf"\b{re.escape(package)}=={re.escape(release)}\s", pins), version


def test_each_tool_has_a_recipe():
    for row in ROWS:
        heading = row[0] if row[2] != "not run" else f"{row[0]} (not run)"
        assert row[0] == "C host" or f"\n### {heading}\n" in PAGE, heading


@pytest.fixture(scope="module")
def folder(built_fmus: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What the recipes expect around them."""
    folder = tmp_path_factory.mktemp("recipes")
    (folder / "build").mkdir()
    (folder / "build" / "fmus").symlink_to(built_fmus)
    (folder / "system").symlink_to(ROOT / "system")
    write_ssp(read_system(ROOT / "system" / "SystemStructure.ssd", built_fmus), folder / "pointing.ssp")
    return folder


@pytest.mark.parametrize("tool", ["The master of ps_fmu", *IMPORTERS])
def test_the_recipe_runs(tool, folder):
    interpreter = interpreter_with("FMPy" if tool == "The master of ps_fmu" else tool)
    before = "from ecos_library import load_tbb\nload_tbb()\n" if tool == "Ecos" else ""
    command = [str(interpreter), "-c", before + recipe(tool)]
    environment = os.environ | {"PYTHONPATH": str(HOSTS)}
    run = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    assert float(run.stdout.split()[-1]) != 0.0, run.stdout
