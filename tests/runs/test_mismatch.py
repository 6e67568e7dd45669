"""Warnings of runs whose FMUs describe different mechanisms."""

import re
import xml.etree.ElementTree as ET
import zipfile
from functools import partial
from pathlib import Path

import pytest
from support.claims import verify_claim

from ps_fmu.cosim import read_parameters
from ps_fmu.cosim.ssp.writing import start_values_xml
from ps_fmu.cosim.structure import Parameter
from ps_fmu.interface.agreement import APART
from ps_fmu.runs.cases import Case, list_mismatches, run_case
from ps_fmu.runs.options import RunOptions
from ps_fmu.runs.setup import load_system
from ps_fmu.scenarios.jitter_record import JitterRecord

SYSTEM = Path(__file__).parents[2] / "system"
SHIPPED = sorted((SYSTEM / "parameters").glob("*.ssv"))


def find_system(given):
    """A system that has all the components of a file; the default one where it has."""
    wanted = {name.partition(".")[0] for name in read_parameters(given)}
    for path in [SYSTEM / "SystemStructure.ssd", *sorted(SYSTEM.glob("*.ssd"))]:
        if wanted <= set(re.findall(r'<ssd:Component name="(\w+)"', path.read_text(encoding="utf-8"))):
            return path
    raise AssertionError(f"no system has {wanted}")


@pytest.fixture
def warnings_of(make_options, ssv):
    """The warnings for some start values."""

    def find(given, values=(), apart=()):
        path = given if isinstance(given, Path) else ssv(given)
        options = make_options("isolation", 1.0, parameters=(path,))
        system = load_system(RunOptions(**vars(options) | {"system": find_system(path)}))
        return list(list_mismatches(system, dict(values), apart))

    return find


def test_the_systems_and_the_sets_that_are_shipped_are_meant(make_options, warnings_of):
    options = make_options("isolation", 1.0)
    for path in sorted(SYSTEM.glob("*.ssd")):
        assert list(list_mismatches(load_system(RunOptions(**vars(options) | {"system": path})), {})) == [], path.name
    assert {path.name: warnings_of(path) for path in SHIPPED} == {path.name: [] for path in SHIPPED}


def test_a_plant_that_the_controllers_do_not_know(warnings_of):
    """A payload of 45 kg, another joint and a longer stroke in the plant alone: rejection was -404 % without a word."""
    by_isolator, by_commander = sorted(
        warnings_of(
            {"plant.payload.mass": 45.0, "plant.fine_leg_1.base_joint.x": 0.2, "plant.coarse_stroke.max": 0.03}
        ),
        key=lambda text: text.startswith("commander"),
    )
    assert by_isolator.startswith("isolator describes another mechanism than the plant. ")
    joint = "fine_leg_1.base_joint: (0.163031, 0.204474, 0.022298) m, the plant's (0.2, 0.204474, 0.022298) m"
    assert joint in by_isolator
    assert "payload.mass: 14.89 kg, the plant's 45 kg" in by_isolator
    assert by_isolator.index("payload.mass") < by_isolator.index("fine_leg_1")  # what differs most comes first
    assert "ps-fmu parameters writes the values of all FMUs" in by_isolator
    assert by_isolator.endswith("--apart isolator") and by_commander.endswith("--apart commander")
    assert "coarse_stroke: (-0.02, 0.02) m, the plant's (-0.02, 0.03) m" in by_commander


def test_the_centre_of_mass_in_the_disturbance_source_alone(warnings_of):
    given = {"disturbance.bus.com.z": -1.0}
    (text,) = warnings_of(given)
    assert "bus.com: (0, 0, -1) m, the plant's (0, 0, -2) m" in text
    assert text.endswith("--apart disturbance.bus.com")
    # Where no noise acts, nothing acts there.
    assert warnings_of(given | {"disturbance.noise.enabled": False}) == []


def test_whatever_a_component_knows_of_the_plant_is_compared(make_options, built_fmus):
    """Each number of the plant changed alone, by one part in a million, against the names in the model descriptions."""

    def read_names(model):
        with zipfile.ZipFile(built_fmus / f"{model}.fmu") as archive:
            variables = ET.fromstring(archive.read("modelDescription.xml")).iterfind(".//ScalarVariable")
        return {one.get("name"): one.find("Real") for one in variables if one.get("causality") == "parameter"}

    models = {"isolator": "FeedforwardIsolator", "commander": "PointingCommander", "disturbance": "DisturbanceSource"}
    known = {component: read_names(model) for component, model in models.items()}
    system = load_system(make_options("isolation", 1.0))
    wrong, shared = [], 0
    for name, real in read_names("ManipulatorPlant").items():
        if real is None:
            continue
        changed = float(real.get("start")) + 1e-6 * max(abs(float(real.get("start"))), 1.0)
        texts = list(list_mismatches(system, {f"plant.{name}": changed}))
        expected = {component for component, own in known.items() if own.get(name) is not None}
        found = {text.split()[0] for text in texts}
        shared += len(expected)
        wrong += [(name, found ^ expected)] if found != expected else []
    assert shared > 100
    verify_claim(
        "warning.mismatch",
        claim="... describes another mechanism than the plant: for each component that knows a number otherwise",
        where="`ps-fmu run`, `ps-fmu sweep`: terminal, report, `warnings` of summary.json",
        reference="names in the modelDescription.xml of the FMUs; each number of the plant is changed alone by 1e-6",
        error=len(wrong),
        bound=0.0,
        unit="numbers missed or named in vain",
    )


def test_the_known_centre_of_mass_is_meant_until_the_plant_changes(warnings_of):
    (text,) = warnings_of({"plant.payload.com.z": 0.2})
    assert "payload.com: (0.00135, 0.00446, 0.1071) m, the plant's (0.00951, 0.00849, 0.2) m" in text
    exact = dict(zip((f"isolator.payload.com.{axis}" for axis in "xyz"), (0.00951, 0.00849, 0.2), strict=True))
    assert warnings_of({"plant.payload.com.z": 0.2, **exact}) == []


def test_what_is_meant_is_said_on_the_command_line(warnings_of):
    given = {"isolator.payload.mass": 14.0, "isolator.fine_leg_1.stiffness": 3e4, "isolator.fine_leg_2.stiffness": 3e4}
    assert len(warnings_of(given)) == 1
    for apart in (
        ["isolator"],
        ["isolator.payload", "isolator.fine_leg_1", "isolator.fine_leg_2.stiffness"],
        ["isolator.fine_leg", "isolator.payload.mass"],
    ):
        assert warnings_of(given, apart=apart) == [], apart
    (text,) = warnings_of(given, apart=["isolator.fine_leg", "isolator.pay", "plant"])
    assert "payload.mass" in text and "stiffness" not in text


def test_what_is_meant_is_said_in_the_file(warnings_of, tmp_path):
    path = tmp_path / "noted.ssv"
    noted = Parameter(14.0, "kg", "", frozenset({APART}))
    values = {"isolator.payload.mass": noted, "isolator.delay": Parameter(0.0, "s", "")}
    path.write_bytes(start_values_xml(values, "a--b"))
    assert read_parameters(path).entries()["isolator.payload.mass"].notes == {APART}
    assert warnings_of(path) == []
    # What a case sets in place of it is not what the file says.
    assert len(warnings_of(path, {"isolator.payload.mass": 13.0})) == 1


def test_numbers_that_are_written_with_fewer_digits_are_the_same(warnings_of):
    assert warnings_of({"isolator.payload.mass": 14.89 * (1.0 + 1e-12)}) == []
    assert len(warnings_of({"isolator.payload.mass": 14.89 * (1.0 + 1e-6)})) == 1


def test_many_differences_are_named_and_few_shown(warnings_of):
    given = {f"plant.{kind}_leg_{i}.lower.mass": 0.9 for kind in ("coarse", "fine") for i in (1, 2, 3)}
    given |= {f"plant.{kind}_leg_{i}.upper.mass": 0.9 for kind in ("coarse", "fine") for i in (1, 2, 3)}
    (text,) = warnings_of(given)
    assert text.count("the plant's 0.9 kg") == 6
    assert "; and 6 more: fine_leg_i.upper.mass, fine_leg_i.lower.mass. " in text


def test_the_case_has_the_last_word(warnings_of):
    given = {"plant.payload.mass": 45.0}
    assert len(warnings_of(given)) == 1
    assert warnings_of(given, {"isolator.payload.mass": 45.0}) == []


def test_a_run_says_it_once_on_the_terminal_and_keeps_it(make_options, ssv, capsys):
    """The texts of ``warnings`` go to summary.json and the report."""
    options = make_options("isolation", 1.0, step_s=1e-3, parameters=(ssv({"plant.payload.mass": 45.0}),))
    text = "isolator describes another mechanism than the plant. payload.mass: 14.89 kg"
    for apart, count in (((), 1), (("isolator.payload",), 0)):
        system, given = load_system(options), RunOptions(**vars(options) | {"apart": apart})
        judge = partial(JitterRecord, step_s=options.step_s, steps=2)
        for name in (f"passive_{count}", f"active_{count}"):
            run_case(system, given, Case(name), judge, duration_s=2 * options.step_s)
        assert [text in warning for warning in system.warnings.texts].count(True) == count
        assert capsys.readouterr().err.count(text) == count
