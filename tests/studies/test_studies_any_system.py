"""A case of a study gives the rows that ``ps-fmu run`` gives with the same parameters, whatever the system is."""

import json
import shutil
import zipfile
from dataclasses import replace

import netCDF4
import numpy as np
import pytest
from support.cosim import simulate
from support.relays import LINEAR, TABLE, binding, description, mapping, port, relay, system, wire

from ps_fmu.cli import main
from ps_fmu.cosim.structure import decode_system
from ps_fmu.disturbance.recording import HEADER
from ps_fmu.studies.bundle import SYSTEM
from ps_fmu.studies.case_runner import CaseRunner
from ps_fmu.studies.preparation import load_study_system, make_bundle
from ps_fmu.studies.study import StudyError, read_study
from ps_fmu.studies.sweep import SweepOptions, prepare

INVERTED = (
    '<ssc:BooleanMappingTransformation><ssc:MapEntry source="true" target="false"/>'
    '<ssc:MapEntry source="false" target="true"/></ssc:BooleanMappingTransformation>'
)
COLOURS = (
    '<ssc:EnumerationMappingTransformation><ssc:MapEntry source="red" target="gruen"/>'
    '<ssc:MapEntry source="blue" target="blau"/></ssc:EnumerationMappingTransformation>'
)
STUDY = """
[study]
system = "{system}"
duration = "0.5 s"
step = "0.1 s"
plan = "list"
seed = 1
{more}
{vary}
[[observe]]
signal = "{observed}"
[signals]
variables = "*"
cases = "all"
"""
OSP = """<OspSystemStructure xmlns="http://opensimulationplatform.com/MSMI/OSPSystemStructure" version="0.1">
<StartTime>1</StartTime><EndTime>3</EndTime><BaseStepSize>0.1</BaseStepSize>
<Simulators><Simulator name="first" source="first.fmu"/>
<Simulator name="second" source="second.fmu" stepSize="0.2"/></Simulators>
<Functions><LinearTransformation name="double" factor="2" offset="1e-3"/></Functions>
<Connections>
<VariableConnection><Variable simulator="first" name="x"/><Variable simulator="second" name="x"/></VariableConnection>
<VariableConnection><Variable simulator="first" name="v"/><Variable simulator="second" name="v"/></VariableConnection>
<SignalConnection><Variable simulator="second" name="F"/><Signal function="double" name="in"/></SignalConnection>
<SignalConnection><Signal function="double" name="out"/><Variable simulator="first" name="F"/></SignalConnection>
</Connections></OspSystemStructure>
"""


@pytest.fixture
def compare(relays, tmp_path):
    """Writes a system and a study of it, runs case 0 and ``ps-fmu run`` with its values: equal rows, which it returns.

    ``values``: what is varied, as a study has it; ``files``: further ones, by name.
    """

    def run(name, text, values, *, observed, files=None, more=""):
        (tmp_path / "resources").mkdir()
        for fmu in relays.glob("*.fmu"):
            shutil.copy(fmu, tmp_path / "resources")
            shutil.copy(fmu, tmp_path)
        for file, content in {name: text, **(files or {})}.items():
            if content is not None:
                (tmp_path / file).write_text(content, encoding="utf-8")
        vary = "".join(f"[[vary]]\nparameter = '{key}'\nvalues = [{json.dumps(v)}]\n" for key, v in values.items())
        study = tmp_path / "study.toml"
        study.write_text(STUDY.format(system=name, vary=vary, observed=observed, more=more), encoding="utf-8")
        prepared = prepare(SweepOptions(study, tmp_path / "study"))
        place = prepared.bundle.unpack(tmp_path)
        for path in [*tmp_path.glob("*.fmu"), *(tmp_path / "resources").iterdir()]:
            path.rename(path.with_suffix(".away"))  # a worker has the bundle alone
        row = CaseRunner(place).run(0, prepared.plan.values(0), tmp_path / "case.nc")
        for path in [*tmp_path.glob("*.away"), *(tmp_path / "resources").iterdir()]:
            path.rename(path.with_suffix(".fmu"))
        assert (row["status"], row["error"]) == ("done", None)
        return study, prepared, row, read(tmp_path / "case.nc", "active")

    return run


def read(path, group):
    with netCDF4.Dataset(path) as file:
        return {name: np.array(variable[:]) for name, variable in file[group].variables.items()}


def make_set(values):
    return (
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues" version="1.0" '
        'name="set"><ssv:Parameters>'
        + "".join(
            f'<ssv:Parameter name="{name}"><ssv:{kind} value="{value}"/></ssv:Parameter>'
            for name, (kind, value) in values.items()
        )
        + "</ssv:Parameters></ssv:ParameterSet>"
    )


def check(tmp_path, found, name, values, *options):
    """``ps-fmu run`` with ``values`` has the rows ``found``, to the last bit; returns them."""
    (tmp_path / "set.ssv").write_text(make_set(values), encoding="utf-8")
    out = tmp_path / "run"
    arguments = ["run", tmp_path / name, "--step", "0.1", "--duration", "0.5", "--parameters", tmp_path / "set.ssv"]
    assert main([*map(str, arguments), *map(str, options), "--no-figures", "--output", str(out)]) == 0
    expected = read(out / "results.nc", "run")
    assert found.keys() == expected.keys()
    for column, own in expected.items():
        assert np.array_equal(found[column], own), column
    return expected


def test_connections_that_convert(compare, tmp_path):
    """Units and a linear transformation, Booleans, Integers, enumerations, Strings; a parameter from a mapping."""
    text = description(
        system(
            relay("a", source="Metre.fmu") + relay("b", source="Milli.fmu") + relay("e", source="English.fmu")
            + relay("g", source="German.fmu"),
            wire("a/real_out", "b/real_in", LINEAR) + wire("a/flag_out", "b/flag_in", INVERTED)
            + wire("a/whole_out", "b/whole_in", TABLE) + wire("e/whole_out", "g/whole_in", COLOURS)
            + wire("a/text_out", "b/text_in"),
            bindings=binding("length=Real:3", "", mapping(f"length>b.gain>{LINEAR}")),
        )
    )  # fmt: skip
    values = {"a.real_in": "2.5 m", "a.flag_in": True, "a.whole_in": 2, "e.whole_in": "blue", "a.text_in": "two words"}
    _, _, row, found = compare("SystemStructure.ssd", text, values, observed="b.real_out")
    assert (row["active.a.flag_out.share"], row["active.b.flag_out.share"]) == (1.0, 0.0)
    kinds = zip(values, ("Real", "Boolean", "Integer", "Enumeration", "String"), strict=True)
    given = {name: (kind, {"a.real_in": "2.5", "a.flag_in": "true"}.get(name, values[name])) for name, kind in kinds}
    rows = check(tmp_path, found, "SystemStructure.ssd", given)
    assert rows["b.real_out"][-1] == 9.0 * (2.0 * 2500.0 + 3.0)
    assert (rows["b.whole_out"][-1], rows["g.whole_out"][-1]) == (9, 30)


INPUTS = "time,u,n\n1,0,1\n1.25,5,1\n1.25,7,3\n2,10,2\n"


def make_outside(version="1.0"):
    """A system with inputs and outputs of its own, in mm and converted, a nested one, and a start time."""
    inner = system(
        relay("r"), wire("v", "r/real_in") + wire("r/real_out", "w") + wire("k", "r/whole_in", TABLE),
        port("v", "input") + port("w", "output") + port("k", "input", "<ssc:Integer/>"),
    )  # fmt: skip
    outer = system(
        relay("m", source="Metre.fmu") + f'<ssd:System name="s">{inner}</ssd:System>',
        wire("u", "m/real_in") + wire("m/real_out", "s/v", LINEAR) + wire("n", "s/k") + wire("s/w", "y", LINEAR),
        port("u", "input", '<ssc:Real unit="mm"/>') + port("n", "input", "<ssc:Integer/>") + port("y", "output"),
        binding("s.r.gain=Real:1.5 nobody.gain=Real:2", 'prefix=""'),
    )
    text = description(outer, '<ssd:DefaultExperiment startTime="1" stopTime="2"/>')
    return text.replace('version="1.0" name="test"', f'version="{version}" name="test"')


@pytest.mark.parametrize("version", ["1.0", "2.0"])
def test_inputs_over_time_and_outputs_of_the_system(compare, tmp_path, version):
    study, prepared, row, found = compare(
        "outside.ssd", make_outside(version), {"s.r.gain": 4.0}, observed="y", files={"in.csv": INPUTS},
        more='inputs = "in.csv"',
    )  # fmt: skip
    given = {"s.r.gain": ("Real", "4")}
    rows = check(tmp_path, found, "outside.ssd", given, "--input", tmp_path / "in.csv")
    assert rows["time"] == pytest.approx(np.arange(1.0, 1.55, 0.1))
    assert rows["u"] == pytest.approx([0.0, 2.0, 4.0, 7.2, 7.6, 8.0])
    assert rows["y"][-1] == pytest.approx(2.0 * 4.0 * (2.0 * 7.2e-3 + 3.0) + 3.0)
    assert (rows["n"][-1], rows["s.r.whole_out"][-1]) == (3, 3)
    assert row["active.y.APE.peak"] == np.abs(rows["y"]).max()
    assert any("nobody" in text for text in prepared.system.warnings.texts)
    assert main(["sweep", str(study), "--case", "0", "--output", str(tmp_path / "again")]) == 0
    again = read(tmp_path / "again" / "results.nc", "active")
    assert np.array_equal(again["y"], rows["y"]) and np.array_equal(again["time"], rows["time"])
    assert json.loads((tmp_path / "again" / "summary.json").read_text())["row"]["active.y.APE.peak"] == np.abs(
        rows["y"]
    ).max()


def test_libcosims_description(compare, tmp_path):
    """With a start time, a step of a component, a linear transformation, and FMUs beside it."""
    values, observed = {"first.x1": 0.3}, "first.x"
    _, _, _, found = compare("OspSystemStructure.xml", OSP, values, observed=observed)
    rows = check(tmp_path, found, "OspSystemStructure.xml", {"first.x1": ("Real", "0.3")})
    assert rows["time"][0] == 1.0 and rows["first.x"][0] == 0.3


@pytest.mark.parametrize(
    ("more", "options"),
    [
        ('extrapolate = "linear"\nrates = { first = "1/2" }', ("--extrapolate", "linear", "--rate", "first=1/2")),
        ('scheme = "iterated"\nsolver = "newton"\ntolerance = 1e-6\nerror_estimate = true',
         ("--scheme", "iterated", "--solver", "newton", "--tolerance", "1e-6", "--error-estimate")),
    ],
)  # fmt: skip
def test_schemes(compare, tmp_path, more, options):
    """The columns of the scheme are stored, too; here no component has a step of its own."""
    osp = OSP.replace(' stepSize="0.2"', "")
    study, _, _, found = compare("OspSystemStructure.xml", osp, {"first.x1": 0.3}, observed="first.x", more=more)
    rows = check(tmp_path, found, "OspSystemStructure.xml", {"first.x1": ("Real", "0.3")}, *options)
    assert main(["sweep", str(study), "--case", "0", "--output", str(tmp_path / "again")]) == 0
    again = read(tmp_path / "again" / "results.nc", "active")
    assert np.array_equal(again["first.x"], rows["first.x"])


@pytest.mark.parametrize(("step", "expected"), [("", 0.25), ('step = "0.1 s"', 0.1)])
def test_the_step_is_that_of_the_system_unless_the_study_states_one(relays, tmp_path, step, expected):
    osp = OSP.replace(' stepSize="0.2"', "").replace("0.1</Base", "0.25</Base")
    (tmp_path / "OspSystemStructure.xml").write_text(osp)
    vary = "[[vary]]\nparameter = 'first.x1'\nvalues = [1]\n"
    text = STUDY.format(system="OspSystemStructure.xml", vary=vary, observed="first.x", more="")
    (tmp_path / "study.toml").write_text(text.replace('step = "0.1 s"', step))
    prepared = prepare(SweepOptions(tmp_path / "study.toml", tmp_path / "out", fmus=relays))
    assert prepared.plan.study.step_s == expected


def test_a_single_fmu(compare, tmp_path):
    values = {"real_in": "3 mm"}
    _, _, _, found = compare("Milli.fmu", None, values, observed="ToyRelay.real_out")
    assert check(tmp_path, found, "Milli.fmu", {"real_in": ("Real", "3")})["ToyRelay.real_out"][-1] == 3.0


def test_an_archive_with_names_that_netcdf_has_not(compare, relays, tmp_path):
    """And with a system and an FMU of one name each in two places."""
    name = "caf\u00e9/\u0394v"
    inner = description(system(relay("r", source="ToyRelay.fmu")))
    outer = relay(name) + (
        '<ssd:Component name="t" type="application/x-ssp-definition" source="resources/inner.ssd"><ssd:Connectors/>'
        "</ssd:Component>"
    )
    with zipfile.ZipFile(tmp_path / "system.ssp", "w") as archive:
        archive.writestr("SystemStructure.ssd", description(system(outer)))
        archive.writestr("resources/inner.ssd", inner)
        archive.write(relays / "ToyRelay.fmu", "resources/ToyRelay.fmu")
        archive.write(relays / "Metre.fmu", "resources/resources/ToyRelay.fmu")
    values = {f"{name}.gain": 2.0, "t.r.real_in": "1 m"}
    study, prepared, _, found = compare("system.ssp", None, values, observed="t.r.real_out")
    check(tmp_path, found, "system.ssp", {f"{name}.gain": ("Real", "2"), "t.r.real_in": ("Real", "1")})
    assert found["caf\u00e9_\u0394v.real_out"][-1] == 0.0
    assert prepared.identity.fmus.keys() == {"ToyRelay", "ToyRelay (t.r)"}
    assert main(["sweep", str(study), "--case", "0", "--output", str(tmp_path / "again")]) == 0


def test_a_study_from_a_checkpoint_with_inputs_over_time(stateful, tmp_path):
    """Time in the file is that of the simulation, as of a run that begins there."""
    for path in stateful.iterdir():
        shutil.copy(path, tmp_path)
    (tmp_path / "in.csv").write_text("time,first.increment\n0,1\n0.35,4\n0.6,2\n")
    inputs = "--input", str(tmp_path / "in.csv"), "--fmus", str(tmp_path)
    system, place = str(tmp_path / "toys.ssd"), str(tmp_path / "settled")
    settle = ["run", system, "--step", "0.1", "--duration", "0.3", *inputs, "--checkpoint", "0.3", "--output", place]
    assert main([*settle, "--no-figures"]) == 0
    vary = "[[vary]]\nparameter = 'mass.mass'\nvalues = [7.0]\n"
    vary += "[from]\ncheckpoint = 'settled'\nanew = 'mass'\n[runs.run]\n"
    study = tmp_path / "study.toml"
    study.write_text(STUDY.format(system="toys.ssd", vary=vary, observed="mass.position", more='inputs = "in.csv"'))
    prepared = prepare(SweepOptions(study, tmp_path / "study", fmus=tmp_path))
    row = CaseRunner(prepared.bundle.unpack(tmp_path)).run(0, prepared.plan.values(0), tmp_path / "case.nc")
    assert (row["status"], row["error"]) == ("done", None)
    found = read(tmp_path / "case.nc", "run")
    rows = check(
        tmp_path, found, "toys.ssd", {"mass.mass": ("Real", "7.0")}, *inputs, "--from", place, "--anew", "mass"
    )
    assert rows["time"][0] == pytest.approx(0.3) and rows["first.increment"].tolist() == [1, 4, 4, 2, 2, 2]


def test_a_recording_travels_with_a_study(built_fmus, tmp_path):
    """In place of the noise, and inside the FMU: workers need no other file."""
    time = np.linspace(0.0, 1.0, 101)
    rows = np.column_stack([time, np.outer(np.sin(20.0 * time), np.arange(1.0, 7.0))])
    np.savetxt(tmp_path / "measured.csv", rows, delimiter=",", header=",".join(HEADER), comments="")
    text = """[study]
plan = "grid"
duration = "0.02 s"
seed = 1
disturbance = "measured.csv"
[[vary]]
parameter = "disturbance.recording.scale"
values = ["1", "2"]
"""
    (tmp_path / "study.toml").write_text(text)
    study, system = load_study_system(replace(read_study(tmp_path / "study.toml"), fmus=built_fmus))
    assert any(text.startswith("disturbance.recording: measured.csv gives") for text in system.warnings.texts)
    place = make_bundle(study, system, {}).unpack(tmp_path)
    (tmp_path / "measured.csv").unlink()
    unpacked = decode_system(place / SYSTEM)
    given = unpacked.component("disturbance").parameters
    assert (given["recording.path"].value, given["noise.enabled"].value) == ("files/measured.csv", False)
    found = simulate(unpacked.with_parameters({"disturbance.recording.scale": 2.0}), 1e-4, 0.02)
    force = found["disturbance.base_force.z"]
    np.testing.assert_allclose(force[[0, 100, 200]], 6.0 * np.sin([0.0, 0.2, 0.4]), atol=1e-9)
    (tmp_path / "study.toml").write_text(text.replace("measured.csv", "measured.nc"))
    with pytest.raises(StudyError, match=r"study, disturbance: expected a file .csv, got 'measured.nc'"):
        read_study(tmp_path / "study.toml")
