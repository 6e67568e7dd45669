"""FMUs of one build share one copy of the package in a process; those of two builds do not."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import ps_fmu

SOURCE = Path(ps_fmu.__file__).parents[1]
MODELS = Path(__file__).with_name("models")

PROGRAM = """
import shutil, sys, tempfile
from pathlib import Path
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

def start(path):
    folder = Path(tempfile.mkdtemp())
    description = read_model_description(path)
    extract(path, folder)
    fmu = FMU2Slave(
        guid=description.guid, unzipDirectory=str(folder), instanceName=Path(path).stem,
        modelIdentifier=description.coSimulation.modelIdentifier,
    )
    fmu.instantiate()
    for call in (fmu.setupExperiment, fmu.enterInitializationMode, fmu.exitInitializationMode):
        call()
    fmu.doStep(0.0, 0.01)
    return fmu, folder

def packages():
    return sorted({name.partition(".")[0] for name in sys.modules if name.startswith("ps_fmu_")})

def modules():
    return sorted(name.partition(".")[2] for name in sys.modules if name.startswith("ps_fmu_") and "." in name)
"""


def in_a_process(code, *arguments):
    command = [sys.executable, "-c", PROGRAM + code, *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True)
    assert (run.returncode, run.stderr) == (0, "")
    return run.stdout.splitlines()


def build_elsewhere(folder, change, *only):
    """The toys, or some, built from a copy of the package with a replacement (file, old, new)."""
    shutil.copytree(SOURCE / "ps_fmu", folder / "src" / "ps_fmu", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(SOURCE.parent / "LICENSE", folder)
    shutil.copytree(MODELS, folder / "fmus", ignore=shutil.ignore_patterns("__pycache__"))
    name, old, new = change
    text = (folder / name).read_text()
    assert old in text
    (folder / name).write_text(text.replace(old, new))
    command = [sys.executable, "-m", "ps_fmu.cli", "build", "--output", "out", *(f"--only={name}" for name in only)]
    environment = {**os.environ, "PYTHONPATH": str(folder / "src")}
    subprocess.run(command, check=True, cwd=folder, env=environment, capture_output=True)
    return folder / "out"


def find_package(fmu):
    with zipfile.ZipFile(fmu) as archive:
        (package,) = {name.split("/")[1] for name in archive.namelist() if name.startswith("resources/ps_fmu_")}
    return package


def test_each_module_is_loaded_once(built):
    code = """
for path in sys.argv[1:]:
    start(path)
print(len(packages()))
print(*modules(), sep="\\n")
"""
    count, *modules = in_a_process(code, *built.values())
    assert count == "1"
    assert len(modules) == len(set(modules))
    assert sum(name == "slavekit.author.slave" for name in modules) == 1
    for name in built:
        assert sum(module.startswith(f"{name}_") for module in modules) == 1


def test_a_module_is_found_when_the_folder_of_the_first_fmu_is_gone(built):
    code = """
(first, folder), *_ = [start(sys.argv[1])]
first.freeInstance()
shutil.rmtree(folder)
for path in sys.argv[2:]:
    fmu, _ = start(path)
    fmu.freeInstance()
fmu, _ = start(sys.argv[1])
print(len(packages()))
"""
    assert in_a_process(code, *built.values()) == ["1"]


def test_fmus_of_two_builds_keep_their_own_code(built, tmp_path):
    change = "src/ps_fmu/slavekit/author/slave.py", "import sys\n", "import sys\n\nMARK = 7\n"
    other = build_elsewhere(tmp_path, change, "oscillator")
    code = """
for path in sys.argv[1:]:
    start(path)
for name in packages():
    print(name, getattr(sys.modules[name + ".slavekit.author.slave"], "MARK", None))
"""
    first, second = built["oscillator"], other / "Oscillator.fmu"
    expected = sorted([f"{find_package(first)} None", f"{find_package(second)} 7"])
    for order in ((first, second), (second, first)):
        assert in_a_process(code, *order) == expected


def test_another_slave_leaves_what_is_shared_alone(built, tmp_path):
    other = build_elsewhere(tmp_path, ("fmus/waves/waves.py", '"""Toy', '"""Other toy'), "oscillator", "waves")
    for name in ("oscillator", "waves"):
        fmu = built[name]
        same = (other / fmu.name).read_bytes() == fmu.read_bytes()
        assert same == (name != "waves")
        assert find_package(other / fmu.name) == find_package(fmu)
