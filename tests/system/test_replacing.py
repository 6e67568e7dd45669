"""FMUs of one's own in place of components: templates, connections by name, and what is said of what does not fit."""

import json
import re
import shutil
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from support.claims import verify_claim

import ps_fmu
from ps_fmu.cli import main
from ps_fmu.cosim import read_system
from ps_fmu.runs.built_fmus import choose_fmus
from ps_fmu.studies.sweep import SweepOptions, prepare

SYSTEM = Path(__file__).parents[2] / "system"
SHORT = {"duration": 0.2, "step": 1e-3, "storage_step": 1e-3, "progress": False}

pytestmark = pytest.mark.usefixtures("built_fmus")


@pytest.fixture(scope="module")
def templates(tmp_path_factory):
    """The FMU of each template, and the system that it runs in."""
    folder, found = tmp_path_factory.mktemp("templates"), {}
    systems = {"isolator": None, "sensor": "InertialSensors.ssd", "controller": "FullInstrument.ssd"}
    for kind in ("isolator", "sensor", "controller", "disturbance"):
        script = folder / f"my_{kind}.py"
        assert main(["new", kind, str(script)]) == main(["build", str(script), "--output", str(folder)]) == 0
        found[kind] = folder / f"My{kind.capitalize()}.fmu", systems.get(kind)
    return found


@pytest.fixture(scope="module")
def isolator(templates):
    return templates["isolator"][0]


ASKED = ("active", "original")


def run(fmu, **options):
    return ps_fmu.simulate("isolation", replace={"isolator": fmu}, **{**SHORT, **options})


def test_the_template_of_an_isolator_isolates_by_the_law_that_it_states(isolator):
    result = run(isolator, duration=5.0)
    assert min(result.summary["rejection_percent"]) > 50.0
    assert result.summary["saturated_fraction"] is None  # it has no force limit, and no flag of it
    case = result.active
    force, rate = np.asarray(case["fine_force"]), np.asarray(case["fine_velocity"])
    elongation = np.array([[-0.0808, -0.1971, -0.0707], [0.2111, 0.0286, -0.0707], [-0.1303, 0.1685, -0.0707]])
    integral = double = np.zeros(3)
    expected = np.zeros_like(force)
    for k, turned in enumerate(np.asarray(case["payload_rotation"])[:-1]):
        w = 2.0 * np.pi * 1.0 * (integral + 2.0 * np.pi * 0.2 * double)
        expected[k + 1] = -32051.8 * elongation @ w - 900.0 * rate[k]
        integral, double = integral + 1e-3 * turned, double + 1e-3 * integral
    verify_claim(
        "run.own_isolator",
        claim="Force of the isolator that `ps-fmu new isolator` writes, in place of FeedforwardIsolator",
        where="`ps-fmu run isolation --replace isolator=MyIsolator.fmu`",
        reference="the law in its text, summed in numpy over the recorded rotation and rates",
        error=np.abs(force - expected)[1:].max() / np.abs(force).max(),
        bound=1e-9,
    )
    assert not np.asarray(result.passive["fine_force"]).any()


def test_poles_of_a_controller_of_ones_own_are_unknown_and_those_beside_it_known(isolator):
    result = run(isolator)
    mine, theirs = (result.stability[case] for case in ASKED)
    assert mine["stable"] is mine["gain_margin_db"] is None
    assert mine["unknown"].startswith("isolator: the linear model does not include the FMU MyIsolator; it includes ")
    assert theirs["stable"] and theirs["gain_margin_db"] == 12.0
    assert "poles and margins of the loop are unknown: isolator: the linear model" in " ".join(str(result).split())


def test_the_template_of_an_isolator_has_the_numbers_of_an_instrument(tmp_path, capsys):
    """Half as long: the legs grow half as much.  A quarter of the stiffness and of the mass: as much of the damping."""
    (tmp_path / "small.toml").write_text(
        'base = "paper"\nmanipulator = { scale = 0.5, fine_legs = { stiffness = 8012.95 } }\n[payload]\nmass = 3.7225\n'
    )
    scripts = [tmp_path / "paper.py", tmp_path / "small.py"]
    assert main(["new", "isolator", str(scripts[0])]) == 0
    assert main(["new", "isolator", str(scripts[1]), "--instrument", str(tmp_path / "small.toml")]) == 0
    turned, stiffness, damping = [], [], []
    for script in scripts:
        text = script.read_text()
        rows = re.search(r"ELONGATION = np.array\((.*)\)", text)[1]
        turned.append(np.array(json.loads(rows)))
        stiffness.append(float(re.search(r'Stiffness of a fine leg", start=([\d.]+)', text)[1]))
        damping.append(float(re.search(r'added to a leg", start=([\d.]+)', text)[1]))
    assert np.abs(turned[1] - 0.5 * turned[0]).max() < 5e-4  # m/rad
    assert stiffness == pytest.approx([32051.8, 8012.95], abs=1e-3) and damping == [900.0, 225.0]
    assert main(["new", "sensor", str(tmp_path / "sensor.py"), "--instrument", "small.toml"]) == 2
    assert "--instrument: the template sensor has no number of an instrument" in capsys.readouterr().err


def test_the_comparison_has_the_unit_of_the_requirements(isolator, tmp_path):
    asked = tmp_path / "asked.toml"
    asked.write_text(
        '[[requirement]]\nname = "a"\nsignal = "plant.payload_rotation.x"\nindex = "APE"\nstatistic = "peak"\n'
        'limit = "1 urad"\ncase = ["active", "original"]\n'
    )
    result = run(isolator, requirements=asked)
    peaks = [1e6 * np.abs(np.asarray(result[case]["payload_rotation"].sel(axis="x"))).max() for case in ASKED]
    assert [one["value"] for one in result.summary["verdicts"]] == pytest.approx(peaks, rel=1e-9)
    mine, theirs = re.search(r"original RMS \(urad\).*\n-+\nx +(\S+) +(\S+)", str(result)).groups()
    assert float(mine) == pytest.approx(1e6 * result.summary["rms_active_rad"][0], rel=1e-3)
    rotation = np.asarray(result["original"]["payload_rotation"].sel(axis="x"))
    assert float(theirs) == pytest.approx(1e6 * np.sqrt(np.mean(rotation**2)), rel=0.02)


@pytest.mark.parametrize("kind", ["sensor", "controller", "disturbance"])
def test_the_other_templates_run(templates, kind, capsys):
    fmu, system = templates[kind]
    component = {"sensor": "sensors", "controller": "pointing"}.get(kind, kind)
    result = ps_fmu.simulate("isolation", replace={component: fmu}, system=system, **SHORT)
    assert all(np.isfinite(result.summary["rms_active_rad"]))
    assert any(text.startswith(f"{component} is {fmu.name} in place of") for text in result.summary["warnings"])


def test_the_same_fmu_gives_the_same_bits(built_fmus, tmp_path):
    """Connections and start values go over: the parameters of the system, and those of a file."""
    same = shutil.copy(built_fmus / "FeedforwardIsolator.fmu", tmp_path / "Other.fmu")
    options = {"system": "FullInstrument.ssd", "parameter_files": ["exact_payload.ssv"]}
    ours, other = ps_fmu.simulate("isolation", **SHORT, **options), run(same, **options)
    assert other.summary["parameters"]["isolator.filters.highpass_frequency"] == 0.02
    assert np.array_equal(
        np.asarray(other["original"]["payload_rotation"]), np.asarray(ours.active["payload_rotation"])
    )
    for case in ("passive", "active"):
        assert np.array_equal(np.asarray(other[case]["payload_rotation"]), np.asarray(ours[case]["payload_rotation"]))


def test_the_text_of_the_script_is_the_documentation(isolator):
    with zipfile.ZipFile(isolator) as archive:
        page = archive.read("documentation/index.html").decode()
    assert "<p>A gyroscope on the payload measures the rotation." in page
    assert "<td><code>crossover</code></td>" in page


def test_what_does_not_fit_is_said(isolator, capsys):
    result = run(isolator, system="Instrument.ssd", parameter_files=["exact_payload.ssv"])
    first, second = (text for text in result.summary["warnings"] if "MyIsolator" in text)
    assert "new connections by name: plant.fine_velocity_1 -> isolator.fine_velocity_1" in first
    assert "left out, for there is no such variable: sensors.estimated_acceleration.x ->" in first
    assert max(map(len, first.splitlines())) <= 100
    assert first.endswith("\n- values left out, for there is no such variable: filters.highpass_frequency")
    assert re.fullmatch(r"isolator: MyIsolator.fmu lacks the variables payload\.com.*: their values .*", second)


@pytest.mark.parametrize(
    ("replacement", "text"),
    [
        ("isolator", "--replace: expected COMPONENT=FILE.fmu, such as isolator=my.fmu, got 'isolator'"),
        ("isolator=none.fmu", "--replace: isolator: there is no file none.fmu"),
        ("isolator=my_isolator.py", "my_isolator.py; ps-fmu build makes an FMU of it"),
        ("engine=MyIsolator.fmu", "there is no component 'engine'; expected one of disturbance, commander, plant"),
        ("plant=MyIsolator.fmu", "MyIsolator.fmu cannot take the place of plant: expected a connected output"),
        ("commander=MyCommander.fmu", "commander (MyCommander.fmu) has no input target.roll of type Real, which"),
        ("isolator=MyCommander.fmu", "has no input enabled of type Boolean, which the scenario sets; enabled is "),
    ],
)  # fmt: skip
def test_refusals(isolator, tmp_path, monkeypatch, capsys, replacement, text):
    monkeypatch.chdir(tmp_path)
    script = isolator.with_name("my_isolator.py")
    shutil.copy(isolator, "MyIsolator.fmu")
    shutil.copy(script, "my_isolator.py")
    if "Commander" in replacement:  # an isolator whose switch is a parameter, and whose forces have another name
        other = script.read_text().replace("class MyIsolator", "class MyCommander")
        other = other.replace('Port("enabled", "input", type', 'Port("enabled", "parameter", type')
        other = other if "isolator=" in replacement else other.replace('"fine_force"', '"coarse_command"')
        Path("my_commander.py").write_text(other)
        assert main(["build", "my_commander.py"]) == 0
    assert main(["run", "isolation", "--replace", replacement, "--output", "out"]) == 2
    assert text in capsys.readouterr().err
    assert not Path("out").exists()


def test_a_study_and_an_archive_take_the_place_alike(isolator, tmp_path, capsys):
    study = tmp_path / "study.toml"
    text = SYSTEM.joinpath("studies", "payload_as_built.toml").read_text()
    study.write_text(text.replace("[study]", '[study]\nreplace = { isolator = "MyIsolator.fmu" }', 1))
    shutil.copy(isolator, tmp_path)
    options = SweepOptions(study, tmp_path / "out")
    assert (
        prepare(options).identity.fmus["MyIsolator"]
        == prepare(
            SweepOptions(SYSTEM / "studies" / "payload_as_built.toml", tmp_path / "out", replace={"isolator": isolator})
        ).identity.fmus["MyIsolator"]
    )
    archive, command = tmp_path / "mine.ssp", ["--replace", f"isolator={isolator}"]
    assert main(["ssp", "--output", str(archive), *command]) == 0
    assert "isolator is MyIsolator.fmu in place of FeedforwardIsolator.fmu" in capsys.readouterr().err
    packed, direct = ps_fmu.simulate("isolation", system=archive, **SHORT), run(isolator)
    assert np.array_equal(np.asarray(packed.active["payload_rotation"]), np.asarray(direct.active["payload_rotation"]))


def test_what_is_listed_is_what_the_fmus_state(built_fmus, capsys):
    assert main(["list", "FullInstrument.ssd", "--json"]) == 0
    listed = {row["name"]: row for row in json.loads(capsys.readouterr().out)}
    system = read_system(SYSTEM / "FullInstrument.ssd", built_fmus)
    expected = {
        f"{component.name}.{variable.name}": (variable.causality, variable.unit, variable.description)
        for component in system.components
        for variable in read_model_description(component.source).modelVariables
        if variable.causality in ("input", "output", "parameter")
    }
    assert listed.keys() == expected.keys()
    for name, (causality, unit, about) in expected.items():
        row = listed[name]
        assert (row["causality"], row["description"]) == (causality, about or "")
        assert row["unit"] == (unit or ("1" if row["type"] == "Real" else None))
    assert listed["isolator.filters.highpass_frequency"]["start"] == 0.02  # that of the system, not of the FMU
    assert listed["coils.force_command_1"]["connected_to"] == "isolator.fine_force_1"
    assert main(["list", "isolation"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= 100
    assert any(re.fullmatch(r"plant\.payload_rotation\.\[xyz\] +reads +rad +Small rotation of P .*", x) for x in lines)
    names = [line.split(" ")[0] for line in lines]
    assert {"plant.fine_leg_{1..3}.stiffness", "plant.payload.mode_{1..12}.participation.tx"} < set(names)
    assert "plant.fine_leg_2.base_joint.x" in names  # the joints differ
    assert main(["list", "slew", "isolator.*", "--needed"]) == 0
    assert re.findall(r"^isolator\S+", capsys.readouterr().out, re.M) == [
        "isolator.enabled",
        "isolator.fine_force_[123]",
    ]
    assert main(["list", "isolation", "plant.payload_rotatoin*"]) == 1
    assert "no variable matches 'plant.payload_rotatoin*'" in capsys.readouterr().err


def test_fmus_of_ps_fmu_are_found_for_any_description(built_fmus, tmp_path):
    own = shutil.copy(SYSTEM / "SystemStructure.ssd", tmp_path / "own.ssd")
    assert choose_fmus(own) == built_fmus
    (tmp_path / "resources").mkdir()
    for name in ("DisturbanceSource", "PointingCommander", "ManipulatorPlant", "FeedforwardIsolator"):
        shutil.copy(built_fmus / f"{name}.fmu", tmp_path / "resources")
    assert choose_fmus(own) is None  # those that the user has beside it count
    assert choose_fmus(own, tmp_path) == tmp_path
    own.write_text(own.read_text().replace("ManipulatorPlant", "Unknown"))
    assert choose_fmus(own) is None  # and who reads it says that there is no Unknown.fmu


def test_passive_is_without_any_loop(tmp_path):
    """The plant then moves as in the system that has no line-of-sight loop at all."""
    with_loop, without = (
        ps_fmu.simulate("isolation", system=f"{name}.ssd", cases=("passive",), **{**SHORT, "duration": 3.0})
        for name in ("LineOfSight", "InertialSensors")
    )
    assert np.array_equal(
        np.asarray(with_loop.passive["payload_rotation"]), np.asarray(without.passive["payload_rotation"])
    )


def test_errors_are_exported():
    for name in ps_fmu.__all__:
        if name.endswith("Error") or name == "Divergence":
            assert issubclass(getattr(ps_fmu, name), Exception)
            assert f"``{name}``" in ps_fmu.__doc__
    with pytest.raises(ps_fmu.OptionError):
        ps_fmu.simulate("isolation", replace={"isolator": "none.fmu"})
    assert issubclass(ps_fmu.Divergence, ps_fmu.CosimError)
