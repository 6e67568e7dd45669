"""ps-fmu wrap and ps-fmu build for slaves of others, up to the FMU; how it runs in a C host is in tests/host."""

import io
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import pytest
from fmpy import read_model_description, simulate_fmu
from fmpy.validation import validate_fmu
from support.archives import DESCRIPTION, put, replace, rewrite
from support.page import build_with_pythonfmu, write_example

import ps_fmu
from ps_fmu.cli import main
from ps_fmu.slavekit.pack.foreign import BuildError, build_script, wrap

TOYS = Path(__file__).parents[1] / "cosim" / "toys"
SLAVE = "resources/tank.py"


@pytest.fixture(scope="module")
def stock(tmp_path_factory):
    """The example as pythonfmu's own command builds it."""
    return build_with_pythonfmu(write_example(tmp_path_factory.mktemp("stock") / "example"))


def run(fmu):
    return simulate_fmu(str(fmu), stop_time=1.0, output_interval=0.1, start_values={"inflow": 0.5})["level"].tolist()


def test_the_example_of_the_page_from_source_and_from_a_stock_fmu(stock, tmp_path, capsys, monkeypatch):
    script = write_example(tmp_path / "source")
    monkeypatch.chdir(tmp_path)
    assert main(["build", str(script)]) == 0
    assert main(["wrap", str(stock), "--output", "wrapped/Tank.fmu"]) == 0
    assert [line.split()[0] for line in capsys.readouterr().out.splitlines()] == ["Tank.fmu", "wrapped/Tank.fmu"]
    built, wrapped = tmp_path / "Tank.fmu", tmp_path / "wrapped" / "Tank.fmu"
    levels = run(built)
    assert levels == run(wrapped)
    assert levels[0] == 1.0
    assert levels[-1] == pytest.approx(1.0 + (0.5 - 0.1) / 2.0, rel=2e-2)
    assert sorted(path.name for path in script.parent.iterdir()) == ["tank.py", "valve.py"]
    for fmu in (built, wrapped):
        assert validate_fmu(str(fmu)) == []
        date = ElementTree.fromstring(zipfile.ZipFile(fmu).read("modelDescription.xml")).get("generationDateAndTime")
        assert date is None if fmu is built else date.endswith("Z")


def test_the_authors_files_stay_and_the_same_source_gives_the_same_bytes(stock, tmp_path):
    given = rewrite(stock, tmp_path / "in.fmu", put("binaries/linux64/libfirst.so", b"author"))
    (first, _), (second, _) = (wrap(given, tmp_path / name) for name in ("a.fmu", "new folder"))
    assert first.read_bytes() == second.read_bytes()
    with zipfile.ZipFile(stock) as before, zipfile.ZipFile(first) as after:
        kept = [name for name in before.namelist() if name.startswith("resources/") and name.endswith(".py")]
        assert SLAVE in kept
        assert all(before.read(name) == after.read(name) for name in kept)
        assert after.read("binaries/linux64/libpythonfmu-export.so") == before.read("binaries/linux64/Tank.so")
        assert after.read("binaries/linux64/libfirst.so") == b"author"
    sources = [write_example(tmp_path / name) for name in ("one", "two")]
    one, two = (build_script(script, output=script.parent)[0].read_bytes() for script in sources)
    assert one == two


def test_a_slave_with_variables_of_all_types_and_nothing_stated(tmp_path):
    fmu, remarks = build_script(TOYS / "toy_counter.py", output=tmp_path)
    assert remarks == []
    assert validate_fmu(str(fmu)) == []
    interface = read_model_description(str(fmu)).coSimulation
    assert not interface.canGetAndSetFMUstate


def test_claims_stay_where_the_trial_run_confirms_them(tmp_path):
    claims = ("--handle-state", "--serialize-state")
    honest = build_with_pythonfmu(write_example(tmp_path / "honest"), *claims)
    fmu, remarks = wrap(honest, tmp_path / "honest.fmu")
    interface = read_model_description(str(fmu)).coSimulation
    assert (interface.canGetAndSetFMUstate, interface.canSerializeFMUstate, remarks) == (True, True, [])
    hidden = ("outflow = ", "self.age = getattr(self, 'age', 0.0) + 0.1\n        outflow = self.age + ")
    forgetful = build_with_pythonfmu(write_example(tmp_path / "forgetful", hidden), *claims)
    fmu, remarks = wrap(forgetful, tmp_path / "forgetful.fmu")
    interface = read_model_description(str(fmu)).coSimulation
    assert (interface.canGetAndSetFMUstate, interface.canSerializeFMUstate) == (False, False)
    assert "canGetAndSetFMUstate is taken back: AssertionError: steps from the same state" in remarks[1]


STATES = """
    def _get_fmu_state(self):
        return {"level": self.level}

    def _set_fmu_state(self, state):
        self.level = state["level"]

    def do_step"""


def test_a_build_claims_the_states_that_a_slave_implements(tmp_path):
    fmu, remarks = build_script(write_example(tmp_path / "source", ("\n    def do_step", STATES)), output=tmp_path)
    interface = read_model_description(str(fmu)).coSimulation
    assert (interface.canGetAndSetFMUstate, interface.canSerializeFMUstate, remarks) == (True, False, [])


UNUSUAL = """
        self.default_experiment = DefaultExperiment(start_time=5.0, step_size=0.5)
        self.register_variable(Real("area", causality=Fmi2Causality.output, variability=Fmi2Variability.constant))

    def do_step(self, current_time, step_size):
        assert current_time >= 5.0
        return True


class Unfinished(Tank, abc.ABC):
    @abc.abstractmethod
    def drain(self):
        pass
"""


def test_a_late_start_a_constant_an_abstract_class_and_a_neighbour_with_a_common_name(tmp_path):
    imports = ("from pythonfmu import", "import abc\nfrom pythonfmu import DefaultExperiment,")
    script = write_example(tmp_path / "source", imports)
    text = script.read_text()
    script.write_text(text[: text.index('        self.register_variable(Real("area"')] + UNUSUAL)
    script.with_name("logging.py").write_text("raise RuntimeError('not imported by the slave')")
    fmu, _ = build_script(script, output=tmp_path / "out")
    assert validate_fmu(str(fmu)) == []


class TestWhatIsRefused:
    """One line that says what the file is, or where the author's code is wrong."""

    @pytest.mark.parametrize(
        ("change", "problem"),
        [
            (lambda files: files.pop("modelDescription.xml"), "has no modelDescription.xml"),
            (lambda files: files.pop("resources/slavemodule.txt"), "not made by pythonfmu"),
            (lambda files: files.pop(SLAVE), "tank.py is missing"),
            (lambda files: files.update({"resources/launcher.txt": b""}), "has a launcher already"),
            (lambda files: files.update({"../outside.py": b""}), "leaves the target folder"),
            (replace(DESCRIPTION, {b'fmiVersion="2.0"': b'fmiVersion="3.0"'}), "FMI 3.0; expected FMI 2.0"),
            (replace(DESCRIPTION, {b"<fmi": b'<!DOCTYPE x [<!ENTITY a "b">]><fmi'}), "document type declaration"),
            (replace(DESCRIPTION, {b'encoding="UTF-8"': b'encoding="cp037"'}), "encoding"),
            (replace(DESCRIPTION, {b"<Log": 1000 * b"<a>" + 1000 * b"</a>" + b"<Log"}), "deeper than 100"),
            (replace(DESCRIPTION, {b'"Tank"': b'"../Tank"'}), "modelIdentifier is '../Tank'"),
            (lambda files: [files.pop(n) for n in list(files) if n[:9] == "binaries/"], "no platform at all"),
            (replace("binaries/linux64/Tank.so", {b"finalizePythonInterpreter": 25 * b"x"}), "not of pythonfmu 0.7"),
        ],
    )
    def test_archives(self, stock, tmp_path, change, problem):
        with pytest.raises(BuildError, match=re.escape(problem)) as error:
            wrap(rewrite(stock, tmp_path / "in.fmu", change), tmp_path / "out.fmu")
        assert "\n" not in str(error.value)
        assert not (tmp_path / "out.fmu").exists()

    def test_what_unpacks_to_more_than_the_archive_says(self, stock, tmp_path):
        content = io.BytesIO(stock.read_bytes())
        with zipfile.ZipFile(content) as archive:
            size = archive.getinfo(SLAVE).file_size
        packed = content.getvalue()
        place = packed.rindex(SLAVE.encode()) - 46 + 24  # the size in the central directory
        (tmp_path / "in.fmu").write_bytes(packed[:place] + (size - 1).to_bytes(4, "little") + packed[place + 4 :])
        with pytest.raises(BuildError, match=r"resources/tank\.py"):
            wrap(tmp_path / "in.fmu", tmp_path / "out.fmu")

    def test_other_files(self, tmp_path, capsys):
        text = tmp_path / "text.fmu"
        text.write_text("text")
        assert main(["wrap", str(text), "--output", str(tmp_path)]) == 1
        assert main(["wrap", str(tmp_path / "absent.fmu"), "--output", str(tmp_path)]) == 1
        assert main(["wrap", str(tmp_path), "--output", str(tmp_path)]) == 1
        first, second, third = capsys.readouterr().err.splitlines()
        assert "text.fmu: is not a readable ZIP archive" in first
        assert second.endswith("absent.fmu: is not there")
        assert third.endswith("it is no ordinary file")

    @pytest.mark.parametrize(
        ("change", "problem"),
        [
            (("class Tank", "class Tank(:"), r"tank\.py: cannot be read as Python: .*line 6"),
            (("(Fmi2Slave)", "(object)"), "No child class of Fmi2Slave"),
            (("self.area, self.level = ", "self.area = "), r'(?s)Traceback.*source/tank.py", line 1\d, in __init__\n'),
            (("import math", "import nowhere_to_be_found"), "(?s)valve.py.*No module named 'nowhere_to_be_found'"),
            (("        return True\n", ""), "do_step did not return True"),
            (("        return True\n", "        __import__('os')._exit(0)\n"), "does not run by itself"),
            (("        return True\n", "        __import__('os')._exit(3)\n"), "does not run by itself"),
            (
                ("        return True\n", "        print('no licence', flush=True); __import__('os')._exit(3)\n"),
                "no licence",
            ),
            (("        return True\n", "        __import__('os')._exit(4)\n"), "does not run by itself"),
            (("import valve", "__import__('os')._exit(0)"), "cannot be built"),
            (("import valve", "from . import valve"), r"source/tank\.py:3: a relative import"),
            (("import math", "__import__('os').write(1, b'\\xff'); 1 / 0"), "(?s)\ufffd.*valve.py.*ZeroDivisionError"),
            (("0.1 * math", "1 / 0 * math"), "(?s)Traceback.*valve.py.*ZeroDivisionError: division by zero"),
        ],
    )
    def test_sources(self, tmp_path, change, problem):
        with pytest.raises(BuildError, match=problem) as error:
            build_script(write_example(tmp_path / "source", change), output=tmp_path / "out")
        assert "slavekit" not in str(error.value)  # nothing of ours in a traceback
        assert not list((tmp_path / "out").glob("*"))

    def test_files_that_do_not_fit(self, tmp_path, capsys):
        script = write_example(tmp_path / "source")
        (tmp_path / "valve.py").write_text("")
        (tmp_path / "json.py").write_text("")
        for more, problem in (
            (tmp_path / "valve.py", "two files are called valve.py"),
            (tmp_path / "absent.csv", "absent.csv: no such file"),
            (tmp_path, "folder above"),
            (tmp_path / "json.py", "a module of Python or pythonfmu has this name too"),
        ):
            with pytest.raises(BuildError, match=problem):
                build_script(script, [more], tmp_path)
        assert main(["build", str(script), "--only", "x"]) == 1
        assert "expected either a script" in capsys.readouterr().err


def test_an_error_in_a_package_is_shown_with_its_place(tmp_path):
    script = write_example(tmp_path / "source", ("import valve", "import tools.pump"))
    (script.parent / "tools").mkdir()
    (script.parent / "tools" / "pump.py").write_text("import json\njson.loads('?')\n")
    with pytest.raises(BuildError, match=r'(?s)source/tank.py", line 3.*tools/pump.py", line 2.*JSONDecodeError'):
        build_script(script, output=tmp_path)


def test_data_files_go_with_the_slave_and_are_found(tmp_path):
    change = ("self.level = 0.0, 2.0, 1.0", "self.level = 0.0, 2.0, float(open(self.resources + '/start.txt').read())")
    script = write_example(tmp_path / "source", change)
    (tmp_path / "start.txt").write_text("4.0")
    fmu, _ = build_script(script, [tmp_path / "start.txt"], tmp_path)
    assert run(fmu)[0] == 4.0


ALONE = """
import sys
from pathlib import Path
from xml.etree import ElementTree
folder, script, stock = map(Path, sys.argv[1:])
sys.path.insert(0, str(folder))
import ps_fmu.slavekit.author.slave
from ps_fmu.slavekit.pack.stages import check_trial
from ps_fmu.slavekit.pack.foreign import build_script
from ps_fmu.slavekit.pack.foreign import wrap
assert Path(ps_fmu.__file__).parent == folder / "ps_fmu"
built, _ = build_script(script, output=folder)
wrapped, _ = wrap(stock, folder / "wrapped.fmu")
for fmu in (built, wrapped):
    check_trial(fmu)
print(*sorted(name for name in sys.modules if name.count(".") == 1 and name.startswith("ps_fmu.")))
"""


def test_the_slave_kit_alone_builds_checks_and_runs_a_slave(stock, tmp_path):
    """In a process where the rest of the package is absent, but for the compiled library."""
    package = Path(ps_fmu.__file__).parent
    (tmp_path / "alone" / "ps_fmu").mkdir(parents=True)
    shutil.copy(package / "__init__.py", tmp_path / "alone" / "ps_fmu")
    for name in ("slavekit", "numerics", "native", "files"):
        shutil.copytree(package / name, tmp_path / "alone" / "ps_fmu" / name)
    arguments = [tmp_path / "alone", write_example(tmp_path / "source"), stock]
    command = [sys.executable, "-I", "-c", ALONE, *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert (result.returncode, result.stderr) == (0, "")
    assert result.stdout == "ps_fmu.files ps_fmu.native ps_fmu.numerics ps_fmu.slavekit\n"
