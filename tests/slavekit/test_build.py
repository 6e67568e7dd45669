"""FMU files: they stand alone, are reproducible, and each runs its own code."""

import hashlib
import io
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from support.host import unpack
from support.twins import InFmpy

from ps_fmu.cli import main
from ps_fmu.slavekit.pack import build
from ps_fmu.slavekit.pack.build import BuildError, build_all, build_one

MODELS = Path(__file__).with_name("models")
SOURCE = Path(build.__file__).parents[3]
STEP = 0.01  # s


def sha256(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def altered(folder, name, *changes):
    """A copy of a toy's folder with some text replaced in its script."""
    shutil.copytree(MODELS / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    script = folder / name / f"{name}.py"
    text = script.read_text()
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    script.write_text(text)
    return folder / name


class Run(InFmpy):
    """An FMU in FMPy, up to its stepping phase."""

    def __init__(self, fmu, folder, **start):
        super().__init__(unpack(fmu, folder))
        self.set(start)
        self.initialise()
        self.n = 0

    def drive(self, n):
        rows = []
        for _ in range(n):
            self.set({"load": np.sin(self.n)})
            self.step(self.n * STEP, STEP)
            self.n += 1
            rows.append(self.fmu.getReal([0, 1]))
        return rows


@pytest.mark.parametrize("name", ["oscillator", "waves", "limiter"])
def test_a_built_fmu_is_valid(built, name):
    assert validate_fmu(str(built[name])) == []


def test_simulate_fmu_equals_the_slave(built, make):
    times = np.arange(101) * STEP
    signal = np.array(list(zip(times, np.sin(times), strict=True)), dtype=[("time", np.float64), ("load", np.float64)])
    result = simulate_fmu(
        str(built["oscillator"]),
        stop_time=1.0,
        output_interval=STEP,
        start_values={"mass": 3.0, "substeps": 4, "note": "x", "engage": False},
        input=signal,
        output=["position", "speed", "engaged"],
    )
    slave = make("oscillator", mass=3.0, substeps=4, engage=False)
    expected = [slave.get_real([0, 1])]
    for i in range(100):
        slave.set_real([slave.layout.find("load")], [signal["load"][i]])
        assert slave.do_step(i * STEP, STEP)
        expected.append(slave.get_real([0, 1]))
    assert len(result) == 101
    np.testing.assert_allclose(np.column_stack([result["position"], result["speed"]]), expected, rtol=1e-12, atol=1e-15)
    assert not result["engaged"].any()


def test_state_through_fmi_is_bit_exact(built, tmp_path):
    run = Run(built["oscillator"], tmp_path / "a", reference=0.5)
    run.drive(7)
    state = run.fmu.getFMUstate()
    content = run.fmu.serializeFMUstate(state)
    expected = run.drive(20)
    run.fmu.setFMUstate(state)
    run.n = 7
    assert run.drive(20) == expected
    run.fmu.freeFMUstate(state)

    other = Run(built["oscillator"], tmp_path / "b")
    state = other.fmu.deSerializeFMUstate(content)
    other.fmu.setFMUstate(state)
    other.fmu.freeFMUstate(state)
    other.n = 7
    assert other.drive(20) == expected
    for instance in (run, other):
        instance.fmu.terminate()
        instance.fmu.freeInstance()


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_two_versions_in_one_process_run_their_own_code(built, tmp_path, order):
    glide = ("GLIDE = 0.1", "GLIDE = 0.01")
    fmus = [built["oscillator"], build_one(altered(tmp_path, "oscillator", glide), tmp_path)]
    runs = {i: Run(fmus[i], tmp_path / f"unzipped_{i}") for i in order}
    rows = {}
    for i in order:
        runs[i].set({"reference": 0.5})
        rows[i] = runs[i].drive(1)
    assert rows[0] != rows[1]
    again = Run(fmus[order[0]], tmp_path / "again")
    again.set({"reference": 0.5})
    assert again.drive(1) == rows[order[0]]
    for run in (*runs.values(), again):
        run.fmu.freeInstance()


def test_loading_leaves_no_trace_in_the_search_path(built, tmp_path):
    before = sys.path[:]
    for i in range(3):
        run = Run(built["oscillator"], tmp_path / str(i))
        run.fmu.terminate()
        run.fmu.freeInstance()
        shutil.rmtree(tmp_path / str(i))
    assert sys.path == before


def test_an_fmu_carries_what_it_needs_under_its_own_names(built):
    with zipfile.ZipFile(built["oscillator"]) as archive:
        names = archive.namelist()
        contents = {name: archive.read(name) for name in names}
        dates = {info.date_time for info in archive.infolist()}
    assert names == sorted(names)
    assert dates == {(1980, 1, 1, 0, 0, 0)}
    entry = contents["resources/slavemodule.txt"].decode()
    (package,) = {name.split("/")[1] for name in names if name.startswith("resources/ps_fmu_")}
    assert {name.split("/")[1] for name in names if name.startswith("resources/")} == {
        "slavemodule.txt",
        "launcher.txt",
        f"{entry}.py",
        package,
    }
    inside = {name.removeprefix(f"resources/{package}/") for name in names if package in name}
    (modules,) = {name for name in inside if name.startswith("modules_")}
    with zipfile.ZipFile(io.BytesIO(contents[f"resources/{package}/{modules}"])) as archive:
        inside |= set(archive.namelist())
        contents |= {name: archive.read(name) for name in archive.namelist()}
    script = sha256(MODELS / "oscillator" / "oscillator.py")[:12]
    assert {f"oscillator_{script}.py", "slavekit/author/slave.py", "pythonfmu/fmi2slave.py"} <= inside
    assert not {"slavekit/pack/build.py", "slavekit/pack/trial.py", "cli.py", "pythonfmu/builder.py"} & inside
    for name in ("index.html", "externalDependencies.txt", "licenses/license.txt", "licenses/pythonfmu.txt"):
        assert contents[f"documentation/{name}"]
    assert "model.png" not in names  # the toy has no icon
    assert not any(name.startswith("terminalsAndIcons") for name in names)
    for name, content in contents.items():
        if not name.startswith("binaries/"):
            assert str(SOURCE.parent).encode() not in content
            assert b"__pycache__" not in content


def test_the_same_source_gives_the_same_bytes_from_another_checkout(built, tmp_path):
    checkout = tmp_path / "elsewhere" / "checkout"
    shutil.copytree(SOURCE / "ps_fmu", checkout / "src" / "ps_fmu", ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(SOURCE.parent / "LICENSE", checkout)
    shutil.copytree(MODELS, checkout / "fmus", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "PYTHONPATH": str(checkout / "src"), "PYTHONHASHSEED": "7"}
    subprocess.run(
        [sys.executable, "-m", "ps_fmu.cli", "build", "--output", "out", "--only", "oscillator"],
        check=True,
        cwd=checkout,
        env=environment,
        capture_output=True,
    )
    assert sha256(checkout / "out" / "Oscillator.fmu") == sha256(built["oscillator"])


def test_a_changed_source_has_another_guid(built, tmp_path):
    other = build_one(altered(tmp_path, "oscillator", ("GLIDE = 0.1", "GLIDE = 0.2")), tmp_path)
    guids = {read_model_description(str(fmu)).guid for fmu in (built["oscillator"], other)}
    assert len(guids) == 2


def test_the_builder_leaves_this_process_as_it_was(tmp_path):
    folder = altered(tmp_path, "waves")
    sys.modules["waves"] = marker = type(sys)("waves")
    path, modules = sys.path[:], set(sys.modules)
    try:
        build_one(folder, tmp_path / "out")
        assert sys.modules["waves"] is marker
    finally:
        del sys.modules["waves"]
    assert sys.path == path
    assert not {name for name in set(sys.modules) - modules if "waves" in name}
    assert sorted(p.name for p in folder.iterdir()) == ["README.md", "waves.py"]


def test_a_missing_project_file_is_noticed(tmp_path, monkeypatch):
    complete = build.collect_modules

    def collect(*args, **kw):
        return {name: content for name, content in complete(*args, **kw).items() if name.name != "guard.py"}

    monkeypatch.setattr(build, "collect_modules", collect)
    with pytest.raises(BuildError, match=r"waves: Waves\.fmu does not run by itself.*\n[\s\S]*No module named.*guard"):
        build_one(MODELS / "waves", tmp_path)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (("import numpy as np", "import numpy as np\nimport helper"), "helper.py"),
        (("import numpy as np", "import numpy as np\nimport ps_fmu.slavekit"), "write 'from ... import ...'"),
        (
            ("import numpy as np", "import numpy as np\nfrom ps_fmu.nothing import x"),
            "No module named 'ps_fmu.nothing'",
        ),
        (('Port("wave", "output", "N"', 'Port("wave", "output", "furlong"'), "unit 'furlong': expected SI units"),
        (("self.request_event()", "1 / 0; self.request_event()"), "ZeroDivisionError"),
        (("class Waves", "def broken(:\n\nclass Waves"), "SyntaxError"),
        (
            (
                "class Waves(Slave):\n",
                "from ps_fmu.slavekit.author.terminals import Terminal\n\n\n"
                'class Waves(Slave):\n    terminals = (Terminal("t", ("torque",), ""),)\n',
            ),
            "there is no variable 'torque'",
        ),
    ],
)
def test_sources_that_cannot_be_built_are_told(tmp_path, change, problem):
    folder = altered(tmp_path / "src", "waves", change)
    (folder / "helper.py").write_text("")
    with pytest.raises(BuildError) as error:
        build_one(folder, tmp_path / "out")
    assert str(error.value).startswith("waves: ")
    assert problem in str(error.value)


def test_incomplete_folders_are_told(tmp_path):
    with pytest.raises(BuildError, match=r"no .*empty\.py"):
        build_one(tmp_path / "empty", tmp_path / "out")
    folder = altered(tmp_path, "waves")
    (folder / "README.md").unlink()
    script = folder / "waves.py"
    script.write_text(re.sub(r'^""".*?"""', "", script.read_text(), flags=re.DOTALL))
    with pytest.raises(BuildError, match=r"a docstring at the top of waves\.py, or .*README\.md, becomes"):
        build_one(folder, tmp_path / "out")
    with pytest.raises(BuildError, match="no nothing; found channel, circuit, limiter, oscillator, pendulum, waves"):
        build_all(tmp_path / "out", MODELS, ["nothing"])


def test_command_line(tmp_path, capsys):
    assert main(["build", "--fmus", str(MODELS), "--only", "waves", "--output", str(tmp_path / "a" / "b")]) == 0
    assert [path.name for path in (tmp_path / "a" / "b").iterdir()] == ["Waves.fmu"]
    assert "Waves.fmu" in capsys.readouterr().out
    assert main(["build", "--fmus", str(MODELS), "--only", "nothing", "--output", str(tmp_path)]) == 1
    assert "ps-fmu build: " in capsys.readouterr().err
    assert main(["build", "--fmus", str(tmp_path / "absent"), "--output", str(tmp_path)]) == 1
    assert main(["biuld"]) == 2
