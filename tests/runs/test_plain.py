"""``ps-fmu run SYSTEM.ssp|.ssd|.xml|FMU``: any system, its files and exit codes."""

import json
import re
import shutil
import zipfile
from pathlib import Path

import netCDF4
import numpy as np
import pytest
from pythonfmu.builder import FmuBuilder
from support.linear import make_oscillator
from support.relays import description, port, relay, system, wire

from ps_fmu.cli import main
from ps_fmu.cosim import Master
from ps_fmu.disturbance.recording import HEADER
from ps_fmu.runs.options import OptionError, choose_run
from ps_fmu.runs.output import hold_folder

TOYS = Path(__file__).parents[1] / "cosim" / "toys"
NAME = "caf\u00e9/\u0394v"
EXPERIMENT = '<ssd:DefaultExperiment startTime="1" stopTime="2.05"/>'


@pytest.fixture(scope="module")
def fmus(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fmus")
    for name in ("relay", "mass", "failing"):
        FmuBuilder.build_FMU(TOYS / f"toy_{name}.py", dest=folder)
    return folder


@pytest.fixture
def archive(fmus, tmp_path):
    """A system with connectors of its own, a component of a name that netCDF has not, and no step."""
    inside = system(
        relay(NAME),
        wire("u", f"{NAME}/real_in").replace(f'Element="{NAME.partition("/")[0]}"', f'Element="{NAME}"')
        + wire("q", "y"),
        port("u", "input") + port("y", "output") + port("q", "input"),
    )
    inside = inside.replace(wire("u", f"{NAME}/real_in"),
        f'<ssd:Connection startConnector="u" endElement="{NAME}" endConnector="real_in"/>')  # fmt: skip
    inside = inside.replace(wire("q", "y"),
        f'<ssd:Connection startElement="{NAME}" startConnector="real_out" endConnector="y"/>')  # fmt: skip
    path = tmp_path / "system.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", description(inside, EXPERIMENT))
        archive.write(fmus / "ToyRelay.fmu", "resources/ToyRelay.fmu")
    return path


def run(*arguments):
    return main(["run", *map(str, arguments)])


def read(folder):
    with netCDF4.Dataset(folder / "results.nc") as file:
        return {name: np.array(variable[:]) for name, variable in file["run"].variables.items()}


def test_an_archive(archive, tmp_path, capsys):
    (tmp_path / "in.csv").write_text("time,u\n1,0\n2,10\n")
    (tmp_path / "set.ssv").write_text(
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
        f'name="s"><ssv:Parameters><ssv:Parameter name="{NAME}.gain"><ssv:Real value="3"/></ssv:Parameter>'
        "</ssv:Parameters></ssv:ParameterSet>", encoding="utf-8",
    )  # fmt: skip
    out = tmp_path / "out"
    options = "--step", "0.1", "--input", tmp_path / "in.csv", "--parameters", tmp_path / "set.ssv"
    assert run(archive, *options, "--output", out) == 0
    found = read(out)
    assert found["time"] == pytest.approx(np.arange(1.0, 2.05, 0.1))  # 1.05 s are not whole steps: the last is left out
    assert found["u"] == pytest.approx(np.arange(0.0, 10.5, 1.0))
    assert found["y"] == pytest.approx(3.0 * np.append(0.0, found["u"][:-1]))
    assert np.array_equal(found["caf\u00e9_\u0394v.real_out"], found["y"])
    summary = json.loads((out / "summary.json").read_text())
    assert summary["components"] == {NAME: "ToyRelay.fmu"}
    assert (summary["duration_s"], summary["inputs"]) == (1.0, ["u"])
    assert (out / "plot.png").read_bytes().startswith(b"\x89PNG")
    assert "results in" in capsys.readouterr().out


def test_one_of_two_names_that_netcdf_does_not_tell_apart_is_drawn(fmus, tmp_path, capsys):
    path = tmp_path / "system.ssp"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("SystemStructure.ssd", description(system(relay("x/y") + relay("x_y"), "", ""), EXPERIMENT))
        archive.write(fmus / "ToyRelay.fmu", "resources/ToyRelay.fmu")
    out = tmp_path / "out"
    assert run(path, "--step", "0.1", "--observe", "x_y.real_out", "--output", out) == 0
    assert set(read(out)) == {"time", "x_y.real_out_2"}
    assert (out / "plot.png").is_file()


def test_outputs_that_are_not_stored_are_not_read(fmus, tmp_path, monkeypatch):
    read_columns = []
    go = Master.run
    monkeypatch.setattr(
        Master, "run", lambda self, *args, **options: read_columns.append({c.name for c in self.columns})
        or go(self, *args, **options),
    )  # fmt: skip
    for extra in ((), ("--observe", "*.position")):
        out = tmp_path / f"out{len(extra)}"
        options = "--step", "0.1", "--duration", "1", "--output", out, "--no-figures", *extra
        assert run(fmus / "ToyMass.fmu", *options) == 0
    assert read_columns[1] == {"ToyMass.position"} < read_columns[0]
    assert read(tmp_path / "out2")["ToyMass.position"].tolist() == read(tmp_path / "out0")["ToyMass.position"].tolist()


def test_a_single_fmu_and_its_inputs(fmus, tmp_path, capsys):
    (tmp_path / "in.csv").write_text("time,force\n0,2\n")
    out = tmp_path / "out"
    assert run(fmus / "ToyMass.fmu", "--step", "0.1", "--duration", "1", "--input", tmp_path / "in.csv",
               "--output", out, "--observe", "*.vel*", "--observe", "ToyMass.mass") == 0  # fmt: skip
    found = read(out)
    assert set(found) == {"time", "ToyMass.velocity", "ToyMass.mass"}
    assert found["ToyMass.velocity"] == pytest.approx(0.1 * np.arange(11))  # force over mass is 1 m/s2
    assert found["ToyMass.mass"].tolist() == [2.0] * 11
    assert run(fmus / "ToyMass.fmu", "--step", "0.1", "--duration", "1", "--output", out, "--no-figures") == 0
    assert "inputs of the system that keep their start values: force" in capsys.readouterr().err


def test_a_scheme(fmus, tmp_path, capsys):
    """Steps of 0.2 s at a force of 2 N and a mass of 2 kg."""
    out = tmp_path / "out"
    options = "--step", "0.1", "--duration", "0.8", "--output", out, "--no-figures", "--scheme", "gauss-seidel"
    (tmp_path / "in.csv").write_text("time,force\n0,2\n")
    assert run(fmus / "ToyMass.fmu", *options, "--rate", "ToyMass=2", "--input", tmp_path / "in.csv") == 0
    assert read(out)["ToyMass.velocity"] == pytest.approx(0.2 * (np.arange(9) // 2))
    assert json.loads((out / "summary.json").read_text())["scheme"] == "gauss-seidel, ToyMass 2"
    assert run(fmus / "ToyMass.fmu", *options, "--error-estimate") == 2
    assert "half steps cannot be made: ToyMass cannot be set back to a state" in capsys.readouterr().err


def test_a_loop_and_its_error(tmp_path, capsys):
    system = make_oscillator().build(tmp_path)
    options = "--step", "0.01", "--duration", "0.2", "--output", tmp_path / "out", "--scheme", "iterated"
    options += "--extrapolate", "linear", "--error-estimate", "--tolerance", "1e-6", "--solver", "newton"
    assert run(system.path, *options) == 0
    found = read(tmp_path / "out")
    assert found["loop_1.passes"][1:].min() >= 1.0
    assert 0.0 < found["loop_1.residual"].max() <= 1.0
    assert 0.0 < found["error_estimate.first"][1:].max() < 1e-3
    exact = make_oscillator().solve(found["time"])
    assert np.abs(found["first.x"] - exact["first.x"]).max() < 2e-3
    assert (tmp_path / "out" / "plot.png").is_file()
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["scheme"] == "iterated, linear, error estimate"


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--duration", "1"], "--step: neither"),
        (["--step", "0.1", "--duration", "1.05"], "--duration: 1.05 s is not a whole number of steps"),
        (["--step", "0.1", "--storage-step", "0.15"], "--storage-step: 0.15 s is not"),
        (["--step", "0.1", "--storage-step", "5"], "--storage-step: 5.0 s is longer than the run of 1.0 s"),
        (["--step", "0"], "expected a time above 0 s"),
        (["--step", "0.1", "--observe", "none*"], "--observe: no output matches 'none*'"),
        (["--step", "0.1", "--input", "none.csv"], "--input: there is no file none.csv"),
        (["--step", "1e-12"], "1e+10 steps of 1e-12 s"),
        (["--step", "0.1", "--rate", "none=2"], "there is no component 'none'"),
        (["--step", "0.1", "--rate", "none"], "--rate: expected COMPONENT=N or COMPONENT=1/N, got 'none'"),
        (["--step", "0.1", "--rate", "a=2", "--rate", "a=1/2"], "--rate: a occurs twice"),
        (["--step", "0.1", "--tolerance", "2"], "relative tolerance: expected a number between 0 and 1, got 2.0"),
        (["--step", "0.1", "--scheme", "iterated", "--extrapolate", "smoothed"], "end at the solution"),
    ],
)
def test_options_that_cannot_be_honoured(archive, tmp_path, capsys, options, reason):
    assert run(archive, *options, "--output", tmp_path / "out") == 2
    assert reason in capsys.readouterr().err
    assert not (tmp_path / "out" / "results.nc").exists()


def test_a_missing_system(tmp_path, capsys):
    assert run(tmp_path / "none.ssp") == 2
    assert "SYSTEM: there is no file" in capsys.readouterr().err


@pytest.fixture
def failing(fmus, tmp_path):
    """Writes a system with one FMU that fails in its way at 0.05 s."""

    def write(mode):
        inside = system(relay("f", '<ssd:ParameterBinding><ssd:ParameterValues><ssv:ParameterSet version="1.0" '
            'name="s"><ssv:Parameters><ssv:Parameter name="mode">'
            f'<ssv:String value="{mode}"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
            "</ssd:ParameterValues></ssd:ParameterBinding>", "ToyFailing.fmu", ""))  # fmt: skip
        (tmp_path / "resources").mkdir()
        (tmp_path / "resources" / "ToyFailing.fmu").write_bytes((fmus / "ToyFailing.fmu").read_bytes())
        (tmp_path / "a.ssd").write_text(description(inside))
        return tmp_path / "a.ssd"

    return write


def test_a_run_that_fails_keeps_its_rows(failing, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(failing("nan"), "--step", "0.01", "--duration", "1", "--output", out) == 1
    error = capsys.readouterr().err
    assert "f: not a finite number at t = 0.06 s" in error and "stopped at t = 0.06 s" in error
    assert f"results so far: {out / 'results.nc'}" in error
    assert len(read(out)["time"]) == 6


def test_an_fmu_that_ends_the_simulation_ends_it_normally(failing, tmp_path, capsys):
    """A slave of plain pythonfmu says so when it refuses a step."""
    out = tmp_path / "out"
    assert run(failing("discard"), "--step", "0.01", "--duration", "1", "--output", out, "--profile") == 0
    printed = capsys.readouterr()
    assert "the FMU has ended the simulation" in printed.err
    assert "us a step" in printed.out
    assert len(read(out)["time"]) == 6
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["ended_by"], summary["ended_at_s"]) == ("f", pytest.approx(0.05))
    assert summary["costs"]["run"]["steps"] == 5


def test_a_system_that_cannot_be_read(archive, tmp_path, capsys):
    with zipfile.ZipFile(tmp_path / "bad.ssp", "w") as bad:
        bad.writestr("SystemStructure.ssd", description(system(relay("a"))))
    assert run(tmp_path / "bad.ssp", "--output", tmp_path / "out") == 1
    error = capsys.readouterr().err
    assert f"{tmp_path / 'bad.ssp'}/SystemStructure.ssd, line 10: component 'a': there is no FMU" in error
    assert "nothing was stored" in error


def test_a_folder_in_use(archive, tmp_path, capsys):
    (tmp_path / "out").mkdir()
    with hold_folder(tmp_path / "out"):
        assert run(archive, "--step", "0.1", "--output", tmp_path / "out") == 2
    assert "another run is writing" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("notes.txt", "expected an archive (.ssp), a system description (.ssd, or libcosim's .xml) or an FMU (.fmu); "),
        ("empty/", "empty is a folder without SystemStructure.ssd and OspSystemStructure.xml"),
        ("none/none.zip", "SYSTEM: there is no file "),
    ],
)
def test_what_is_no_system(tmp_path, capsys, name, reason):
    (tmp_path / "notes.txt").write_text("")
    (tmp_path / "empty").mkdir()
    assert run(f"{tmp_path}/{name}") == 2
    printed = capsys.readouterr().err.splitlines()
    assert reason in printed[-1]
    assert len(printed) == 2  # how to call it, and what is wrong


@pytest.mark.parametrize("name", ["", "OspSystemStructure.xml"])
def test_a_description_of_libcosim(fmus, tmp_path, monkeypatch, name):
    folder = tmp_path / "ship"
    folder.mkdir()
    shutil.copy(fmus / "ToyMass.fmu", folder)
    (folder / "OspSystemStructure.xml").write_text(
        '<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">'
        "<BaseStepSize>0.1</BaseStepSize><Algorithm>ecco</Algorithm><Simulators>"
        '<Simulator name="mass" source="ToyMass.fmu"/></Simulators></OspSystemStructure>'
    )
    monkeypatch.chdir(tmp_path)
    assert run(f"ship/{name}" if name else "ship", "--duration", "1", "--output", "out", "--no-figures") == 0
    assert len(read(tmp_path / "out")["time"]) == 11
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert any("Algorithm 'ecco' is not supported" in text for text in summary["warnings"])


def test_a_folder_with_a_description(archive, tmp_path):
    with zipfile.ZipFile(archive) as packed:
        packed.extractall(tmp_path / "system")
    assert run(f"{tmp_path}/system", "--step", "0.1", "--no-figures", "--output", tmp_path / "out") == 0
    assert len(read(tmp_path / "out")["time"]) == 11


def change(fmu, target, name, **replaced):
    """A copy of an FMU with another member, or without it."""
    with zipfile.ZipFile(fmu) as old, zipfile.ZipFile(target, "w") as new:
        for member in old.namelist():
            text = old.read(member)
            if member.startswith(name) and "to" in replaced:
                new.writestr(member.replace(name, replaced["to"]), text)
            elif member == name:
                for before, after in replaced["text"].items():
                    assert before in text.decode()
                    text = text.decode().replace(before, after).encode()
                new.writestr(member, text)
            else:
                new.writestr(member, text)
    return target


@pytest.mark.parametrize("options", [[], ["--isolate"]])
def test_an_fmu_for_another_platform(fmus, tmp_path, capsys, options):
    fmu = change(fmus / "ToyMass.fmu", tmp_path / "a.fmu", "binaries/linux64", to="binaries/vax")
    assert run(fmu, "--step", "0.1", "--duration", "1", "--output", tmp_path / "out", *options) == 1
    assert "no binaries/linux64/ToyMass.so in the FMU, only binaries for " in (error := capsys.readouterr().err)
    assert "vax" in error and "ask its maker for linux64" in error


@pytest.mark.parametrize("version", ["1.0", "3.0"])
def test_an_fmu_of_another_version(fmus, tmp_path, capsys, version):
    text = {'fmiVersion="2.0"': f'fmiVersion="{version}"'}
    fmu = change(fmus / "ToyMass.fmu", tmp_path / "a.fmu", "modelDescription.xml", text=text)
    assert run(fmu, "--output", tmp_path / "out") == 1
    reason = f"a.fmu: expected an FMU of FMI 2.0, got fmiVersion '{version}': export it as that"
    assert reason in capsys.readouterr().err


def test_a_parameter_with_a_misspelt_component(fmus, tmp_path, capsys):
    (tmp_path / "set.ssv").write_text(
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
        'name="s"><ssv:Parameters>\n<ssv:Parameter name="ToyMas.mass"><ssv:Real value="3"/></ssv:Parameter>'
        "</ssv:Parameters></ssv:ParameterSet>"
    )
    assert run(fmus / "ToyMass.fmu", "--step", "0.1", "--duration", "1", "--parameters", tmp_path / "set.ssv",
               "--output", tmp_path / "out") == 1  # fmt: skip
    assert "line 2): there is no such variable in ToyMass.fmu; did you mean ToyMass.mass" in capsys.readouterr().err


def test_a_name_is_a_scenario_first_then_a_file(tmp_path, monkeypatch):
    """A file of a scenario's name is ./slew."""
    monkeypatch.chdir(tmp_path)
    for name in ("slew", "a.ssd", "b.FMU"):
        (tmp_path / name).touch()
    found = [choose_run(what) for what in ("slew", "a.ssd", "b.FMU")]
    assert [scenario.name for scenario, _ in found] == ["slew", "plain", "plain"]
    assert choose_run("isolation", Path("a.ssd"))[1] == choose_run("plain", Path("a.ssd"))[1] == Path("a.ssd")
    for what, other, reason in (
        ("slow", None, "there is no scenario 'slow'; did you mean slew"),
        ("./slew", None, "slew is another file"),
        ("a.ssd", Path("a.ssd"), "--system: only a scenario takes it"),
        ("plain", None, "name the system that plain runs"),
    ):
        with pytest.raises(OptionError, match=reason):
            choose_run(what, other)


def test_what_any_system_gets_of_a_run(built_fmus, tmp_path, capsys):
    """Requirements, indices, a seed, where it comes from: as a scenario has them."""
    (tmp_path / "own.toml").write_text(
        "[[requirement]]\nname = 'strict'\ncase = 'run'\nsignal = 'plant.los'\ncombine = 'norm'\nindex = 'APE'\n"
        "statistic = 'rms'\nconfidence = 0.9\nlimit = '1e-9 um'\n"
    )
    words = "SystemStructure.ssd", "--duration", "0.02", "--step", "1e-3", "--no-figures", "--seed", "3"
    out = tmp_path / "out"
    assert run(*words, "--requirements", tmp_path / "own.toml", "--output", out) == 1
    assert "all results are written" in capsys.readouterr().err
    summary = json.loads((out / "summary.json").read_text())
    assert (summary["seed"], summary["verdicts"][0]["met"]) == (3, False)
    assert summary["indices"]["run"]["plant.los.x"]["APE"]["values"] > 0
    assert (out / "report.html").is_file()
    with netCDF4.Dataset(out / "results.nc") as file:
        assert "ps-fmu run SystemStructure.ssd --duration 0.02" in file.history
        assert "plant.payload.mass" in file["parameters"]["parameter"][:]


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--apart", "a"], "--apart: only scenarios take it"),
        (["--seed", "3"], "--seed: .* has no disturbance source"),
        (["--disturbance", "in.csv"], "--disturbance: .* has no disturbance source"),
    ],
)
def test_what_only_systems_of_ps_fmu_have(archive, tmp_path, monkeypatch, capsys, options, reason):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "in.csv").write_text("\n".join([",".join(HEADER), "0" + ",0" * 6, "9" + ",0" * 6]))
    assert run(archive, "--step", "0.1", *options) == 2
    assert re.search(reason, capsys.readouterr().err)


def test_a_system_of_ps_fmu_finds_its_fmus_from_any_folder(built_fmus, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert run("Instrument.ssd", "--duration", "0.001", "--no-figures", "--output", "out") == 0
    assert json.loads((tmp_path / "out" / "summary.json").read_text())["components"]["plant"] == "ManipulatorPlant.fmu"


def test_fmus_of_a_description_from_a_folder(fmus, built_fmus, tmp_path, capsys):
    path = tmp_path / "own.ssd"
    path.write_text(description(system(relay("a"))))
    arguments = path, "--step", "0.1", "--duration", "1", "--no-figures", "--output", tmp_path / "out"
    assert run(*arguments) == 1
    error = capsys.readouterr().err
    assert f"there is no FMU {tmp_path}/resources/ToyRelay.fmu" in error
    assert f"ps-fmu run {path} --fmus DIR takes FMUs by their file names from a folder" in error
    assert run(*arguments, "--fmus", fmus) == 0
    assert run(*arguments, "--fmus", tmp_path / "none") == 2
    assert f"--fmus: there is no folder {tmp_path}/none" in capsys.readouterr().err


def test_a_scenario_says_what_runs_a_foreign_system(archive, tmp_path, capsys):
    assert run("isolation", "--ssp", archive, "--duration", "1", "--output", tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "there is no component 'plant', of which the scenario uses payload_rotation.x" in said
    assert f"ps-fmu run {archive} runs any system" in said


def test_a_value_for_a_connected_input_is_a_warning(fmus, tmp_path, capsys):
    (tmp_path / "both.ssd").write_text(description(system(relay("a") + relay("b"), wire("a/real_out", "b/real_in"))))
    (tmp_path / "set.ssv").write_text(
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
        'name="s"><ssv:Parameters>\n<ssv:Parameter name="b.real_in"><ssv:Real value="3"/></ssv:Parameter>'
        "</ssv:Parameters></ssv:ParameterSet>"
    )
    options = "--step", "0.1", "--duration", "1", "--fmus", fmus, "--parameters", tmp_path / "set.ssv", "--no-figures"
    assert run(tmp_path / "both.ssd", *options, "--output", tmp_path / "out") == 0
    text = "b.real_in ({}, line 2) acts only until the first exchange: it is connected to a.real_out"
    assert text.format(tmp_path / "set.ssv") in capsys.readouterr().err


def test_a_plot_of_an_earlier_run_does_not_stay(archive, tmp_path, capsys):
    times = "--step", "0.1", "--output", tmp_path / "out"
    assert run(archive, *times) == 0
    assert run(archive, *times, "--no-figures") == 0
    assert not (tmp_path / "out" / "plot.png").exists()
    assert "plot.png" not in capsys.readouterr().out.splitlines()[-1]


def test_a_refused_run_leaves_no_empty_folder(archive, tmp_path, capsys):
    assert run(archive, "--step", "0.1", "--observe", "none*", "--output", tmp_path / "a" / "b") == 2
    assert not (tmp_path / "a").exists()


def test_an_fmu_without_outputs_leaves_its_times(tmp_path):
    script = tmp_path / "quiet.py"
    script.write_text(
        "from pythonfmu import Fmi2Causality, Fmi2Slave, Real\n"
        "class Quiet(Fmi2Slave):\n"
        "    def __init__(self, **given):\n"
        "        super().__init__(**given)\n"
        "        self.u = 0.0\n"
        "        self.register_variable(Real('u', causality=Fmi2Causality.input))\n"
        "    def do_step(self, t, h):\n"
        "        return True\n"
    )
    fmu, out = FmuBuilder.build_FMU(script, dest=tmp_path), tmp_path / "out"
    assert main(["run", str(fmu), "--step", "0.125", "--duration", "1", "--no-figures", "--output", str(out)]) == 0
    with netCDF4.Dataset(out / "results.nc") as file:
        assert list(file["run"].variables) == ["time"]
        np.testing.assert_array_equal(file["run/time"][:], np.arange(9) * 0.125)
