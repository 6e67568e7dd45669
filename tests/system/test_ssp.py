"""The system as one .ssp file: same bytes, same wiring, and the same numbers in every importer that is installed."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from fmpy.ssp.simulation import simulate_ssp
from fmpy.ssp.ssd import read_ssv, validate_tree
from lxml import etree
from support.cosim import simulate
from support.importers import interpreter_with

from ps_fmu.cli import main
from ps_fmu.cosim import Master, System, read_system, write_ssp
from ps_fmu.cosim.description import index_variables, read_description
from ps_fmu.cosim.structure import Parameter
from ps_fmu.disturbance import Disturbance
from ps_fmu.disturbance.recording import HEADER as RECORDING
from ps_fmu.interface.system_model import read_disturbance

ROOT = Path(__file__).parents[2]
SSD = ROOT / "system" / "SystemStructure.ssd"
HOSTS = Path(__file__).parent / "hosts"
STEP, STEPS = 1e-4, 200  # s
CHOSEN = {"plant.payload.mass": 40.0, "commander.target.roll": 0.01, "disturbance.seed": 7, "isolator.enabled": True}
READ = {
    "plant": ("payload.mass", "payload_rotation.x", "base_acceleration.z", "los.y"),
    "isolator": ("enabled", "fine_force_1"),
    "commander": ("target.roll", "coarse_command_1"),
    "disturbance": ("base_force.x",),
}
NOTES = {"plant.payload.mass": frozenset({"org.example.note"})}


@pytest.fixture(scope="module")
def system(built_fmus: Path) -> System:
    """The system of this project, with values that are not those of the FMUs, and a note at one."""
    values = {name: Parameter(value, None, "chosen", NOTES.get(name, frozenset())) for name, value in CHOSEN.items()}
    return read_system(SSD, built_fmus).with_parameters(values)


@pytest.fixture(scope="module")
def archive(system: System, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("ssp") / "pointing.ssp"
    write_ssp(system, path)
    return path


@pytest.fixture(scope="module")
def expected(system: System) -> dict[str, float]:
    """What our own master reads at the end, from the system as it was before it became an archive."""
    with Master(system, STEP) as master:
        master.initialise()
        master.run(STEPS * STEP)
        return {f"{c}.{name}": master.get(f"{c}.{name}") for c, names in READ.items() for name in names}


def shape(element: ElementTree.Element) -> tuple:
    """An element as data: numbers by value, units in any order, without the parameter bindings."""
    attributes = {}
    for key, text in element.attrib.items():
        try:
            attributes[key] = float(text)
        except ValueError:
            attributes[key] = text
    children = [shape(e) for e in element if not e.tag.endswith("}ParameterBindings")]
    return element.tag, attributes, sorted(children, key=str) if element.tag.endswith("}Units") else children


def test_the_same_system_gives_the_same_bytes(system, archive, tmp_path):
    write_ssp(system, tmp_path / "again.ssp")
    assert (tmp_path / "again.ssp").read_bytes() == archive.read_bytes()
    with zipfile.ZipFile(archive) as opened:
        assert opened.namelist() == sorted(opened.namelist())
        assert {entry.date_time for entry in opened.infolist()} == {(1980, 1, 1, 0, 0, 0)}


def test_the_archive_says_what_the_description_says(archive):
    """Only the bindings are new; what is written for other tools is what was measured to work."""
    with zipfile.ZipFile(archive) as opened:
        written = opened.read("SystemStructure.ssd")
    assert shape(ElementTree.fromstring(written)) == shape(ElementTree.fromstring(SSD.read_bytes()))
    assert b"<ssd:SystemStructureDescription xmlns:ssd=" in written


def test_no_component_has_annotations(archive):
    """OMSimulator refuses the whole system otherwise."""
    with zipfile.ZipFile(archive) as opened:
        root = ElementTree.fromstring(opened.read("SystemStructure.ssd"))
    space = root.tag.removesuffix("SystemStructureDescription")
    components = list(root.iter(f"{space}Component"))
    assert len(components) == 4
    assert all(component.find(f"{space}Annotations") is None for component in components)


def test_the_files_fit_their_schemas(archive):
    with zipfile.ZipFile(archive) as opened:
        validate_tree(etree.fromstring(opened.read("SystemStructure.ssd")), "SystemStructureDescription.xsd")
        sets = [name for name in opened.namelist() if name.endswith(".ssv")]
        assert sets == [f"resources/{name}.ssv" for name in ("commander", "disturbance", "isolator", "plant")]
        for name in sets:
            root = etree.fromstring(opened.read(name))
            validate_tree(root, "SystemStructureParameterValues.xsd")
            assert root.get("name") == "initialValues"


def test_the_sets_hold_open_inputs_switches_and_what_was_chosen(archive):
    stated = {f"{c.name}.{name}": p.value for c in read_system(archive).components for name, p in c.parameters.items()}
    assert CHOSEN.items() <= stated.items()
    assert {"commander.target.yaw", "disturbance.noise.enabled", "isolator.filters.lowpass_order"} <= stated.keys()
    of_plant = {name.removeprefix("plant.") for name in stated if name.startswith("plant.")}
    kinds = {name.rpartition(".")[0] or name.rpartition("_")[0] for name in of_plant - {"payload.mass"}}
    motion = {f"prescribed_{kind}" for kind in ("acceleration", "angular_acceleration", "angular_velocity")}
    assert kinds == {"added_fine_force", "payload_force", "payload_torque", *motion}
    assert "payload.mass" in of_plant


def test_notes_at_values_stay(archive):
    system = read_system(archive)
    found = {f"{c.name}.{name}": p.notes for c in system.components for name, p in c.parameters.items() if p.notes}
    assert found == NOTES


def test_the_archive_runs_as_the_description_does(system, archive):
    direct, packed = simulate(system, STEP, 0.02), simulate(read_system(archive), STEP, 0.02)
    assert direct.names == packed.names
    np.testing.assert_array_equal(direct.values, packed.values)


@pytest.mark.parametrize("tool", ["libcosim", "Ecos"])
def test_another_importer_gets_the_same_numbers(tool, system, archive, expected):
    """The whole loop, Jacobi at the archive's step; values that are not those of the FMUs have arrived."""
    interpreter = interpreter_with(tool)
    wanted: dict[str, dict] = {}
    for component in system.components:
        variables = index_variables(read_description(component.source))
        wanted[component.name] = {n: (variables[n].valueReference, variables[n].type) for n in READ[component.name]}
    extra = [str(STEP)] if tool == "Ecos" else []
    script = HOSTS / f"in_{tool.lower()}.py"
    command = [str(interpreter), str(script), str(archive), json.dumps(wanted), str(STEPS), *extra]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    values = json.loads(run.stdout.splitlines()[-1])
    assert values.keys() == expected.keys()
    for name, value in expected.items():
        assert values[name] == pytest.approx(value, rel=1e-9, abs=0.0), name
    assert values["plant.payload.mass"] == 40.0
    assert values["plant.payload_rotation.x"] != 0.0


def test_the_archive_becomes_one_fmu(archive, expected, tmp_path):
    """fmu-manipulation-toolbox makes an FMU of it, whose C code steps the four as our master does (Jacobi)."""
    interpreter = interpreter_with("FMU container")
    system = read_system(archive)
    components = {
        c.name: [
            c.source.stem,
            [name for name in READ[c.name] if name not in c.parameters],
            {name: str(p.value).lower() for name, p in c.parameters.items()},
        ]
        for c in system.components
    }
    command = [str(interpreter), str(HOSTS / "in_container.py"), str(archive), json.dumps(components)]
    run = subprocess.run([*command, str(STEPS), str(STEP), str(tmp_path)], capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    values = json.loads(run.stdout.splitlines()[-1])
    assert len(values) == 6
    for name, value in values.items():
        assert value == pytest.approx(expected[name], rel=1e-9, abs=0.0), name


def test_fmpy_runs_the_archive(built_fmus, ssv, tmp_path):
    """FMPy starts from zero inputs, labels its rows one step early, and takes values from one flat set only."""
    interpreter_with("FMPy")
    system, flat, path = read_system(SSD, built_fmus), ssv({"plant.payload.mass": 40.0}), tmp_path / "pointing.ssp"
    write_ssp(system, path)
    theirs = simulate_ssp(str(path), stop_time=0.02 - STEP / 2, step_size=STEP, parameter_set=read_ssv(str(flat)))
    ours = simulate(system.with_parameters({"plant.payload.mass": 40.0}), STEP, 0.02)
    for name in ("plant.base_acceleration.x", "isolator.fine_force_1"):
        np.testing.assert_array_equal(theirs[name], ours[name][1:], err_msg=name)
    assert not np.array_equal(simulate(system, STEP, 0.02)["isolator.fine_force_1"], ours["isolator.fine_force_1"])


def test_the_command(built_fmus, ssv, tmp_path, capsys):
    output, flat = tmp_path / "pointing.ssp", ssv({"plant.payload.mass": 40.0})
    arguments = ["ssp", "--output", str(output), "--system", str(SSD), "--fmus", str(built_fmus)]
    assert main([*arguments, "--parameters", str(flat)]) == 0
    assert capsys.readouterr().out.startswith(str(output))
    assert read_system(output).component("plant").parameters["payload.mass"].value == 40.0
    ssv({"plant.payload.maas": 40.0})
    assert main([*arguments, "--parameters", str(flat)]) == 1
    assert "did you mean payload.mass" in capsys.readouterr().err


def test_a_scenario_runs_from_the_archive(archive, tmp_path):
    """The summary names the values of the archive, and no FMU of the checkout was needed."""
    command = [sys.executable, str(ROOT / "system" / "run.py"), "isolation", "--ssp", str(archive)]
    command += ["--duration", "0.02", "--no-figures", "--output", str(tmp_path)]
    run = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert run.returncode == 0, run.stdout + run.stderr
    assert "plant.payload.mass" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_files_that_parameters_name_travel_with_the_archive(built_fmus, tmp_path):
    """Recording, speeds, spectrum and harmonics, also of a further wheel: the same bits where the files are not."""
    here = tmp_path / "here"
    here.mkdir()
    times = np.arange(0.0, 0.0501, 1e-3)
    rows = np.column_stack([times, np.outer(np.sin(200.0 * times), np.arange(1.0, 7.0))])
    np.savetxt(here / "measured.csv", rows, delimiter=",", header=",".join(RECORDING), comments="")
    (here / "speed.csv").write_text("time [s],speed [rpm]\n0,1000\n1,2000\n")
    (here / "spectrum.csv").write_text("frequency [Hz],force.x [N2/Hz]\n1,1e-3\n400,1e-3\n")
    (here / "wheel.csv").write_text("order [1],force [g.cm]\n2,0.5\n")
    wheel = {"enabled": True, "harmonics": str(here / "wheel.csv")}
    values = {
        "recording.path": str(here / "measured.csv"), "wheel_1.speed_profile": str(here / "speed.csv"),
        "wheel_1.enabled": True, "noise.spectrum": str(here / "spectrum.csv"), "rise_time": 0.1,
        "more_wheels": json.dumps([wheel]),
    }  # fmt: skip
    system = read_system(SSD, built_fmus).with_parameters({f"disturbance.{name}": v for name, v in values.items()})
    expected = simulate(system, STEP, 0.05)
    assert write_ssp(system, tmp_path / "all.ssp") == ()
    here.rename(tmp_path / "gone")
    again = read_system(tmp_path / "all.ssp")
    texts = [str(entry.value) for entry in again.component("disturbance").parameters.values()]
    assert not any(str(tmp_path) in text for text in texts)
    assert {"files/measured.csv", "files/speed.csv", "files/spectrum.csv"} < set(texts)
    found = simulate(again, STEP, 0.05)
    for name in ("disturbance.base_force.x", "disturbance.base_torque.z", "plant.payload_rotation.y"):
        np.testing.assert_array_equal(found[name], expected[name], err_msg=name)
    assert np.abs(found["disturbance.base_force.x"]).max() > 0.5
    model = Disturbance(read_disturbance(again, "disturbance"))  # as budgets read it
    wrench = model(STEP * np.arange(STEPS // 4 + 1))
    np.testing.assert_array_equal(found["disturbance.base_force.x"][: len(wrench)], wrench[:, 0])
    (tmp_path / "private.txt").write_text("not for others")
    other = system.with_parameters({"disturbance.recording.path": str(tmp_path / "private.txt")})
    (text,) = (line for line in write_ssp(other, tmp_path / "other.ssp") if "private" in line)
    assert text.endswith("private.txt stays where it is: only .csv files travel")
    write_ssp(again, tmp_path / "second.ssp")  # what is packed stays packed
    np.testing.assert_array_equal(
        simulate(read_system(tmp_path / "second.ssp"), STEP, 0.05)["disturbance.base_force.x"],
        expected["disturbance.base_force.x"],
    )
