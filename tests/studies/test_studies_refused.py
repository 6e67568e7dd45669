"""Studies of any system that cannot be run are refused before anything runs: by table, file and line."""

import json
import re
import shutil

import pytest
from support.relays import LINEAR, description, port, relay, system, wire

from ps_fmu.cosim import CosimError
from ps_fmu.studies.bundle import open_folder, read_identity
from ps_fmu.studies.study import StudyError
from ps_fmu.studies.sweep import SweepOptions, prepare

STUDY = """
[study]
system = "system.ssd"
duration = "0.5 s"
step = "0.1 s"
plan = "list"
seed = 1
inputs = "in.csv"
[[vary]]
parameter = "a.gain"
values = [1, 2]
[[observe]]
signal = "b.real_out"
"""
SYSTEM = description(
    system(
        relay("a") + relay("b", source="Metre.fmu") + relay("e", source="English.fmu"),
        wire("a/real_out", "b/real_in") + wire("u", "a/real_in") + wire("v", "a/level_in") + wire("w", "b/level_in")
        + wire("z", "e/level_in", LINEAR),
        "".join(port(name, "input") for name in "uvwz"),
    )
)  # fmt: skip
WHOLE = ('parameter = "a.gain"', 'parameter = "a.whole_in"')
ENUMERATION = ('parameter = "a.gain"', 'parameter = "e.whole_in"')
STEPS = 'distribution = "steps"\nlow = 1\nhigh = {}\ncount = 3'


@pytest.fixture
def write(relays, tmp_path):
    """Writes the study with replacements; its path."""
    (tmp_path / "resources").mkdir()
    for name in ("ToyRelay", "Metre", "English"):
        shutil.copy(relays / f"{name}.fmu", tmp_path / "resources")
    (tmp_path / "system.ssd").write_text(SYSTEM)

    def make(*changes, more="", inputs="time,u\n0,1\n1,2\n"):
        text = STUDY + more
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        (tmp_path / "in.csv").write_text(inputs)
        path = tmp_path / "study.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return make


@pytest.fixture
def plan(write, tmp_path):
    """Prepares such a study."""
    return lambda *arguments, **named: prepare(SweepOptions(write(*arguments, **named), tmp_path / "out"))


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ([("a.gain", "b.real_in")], "b.real_in is connected to a.real_out: a start value would have no effect"),
        ([("a.gain", "a.real_in")], "a.real_in gets u of the file of inputs: a start value would have no effect"),
        ([("a.gain", "a.real_out")], "a.real_out cannot be set: expected an input or a parameter"),
        ([('"a.gain"', '"z"')], "input 'z' is converted for e.level_in: vary e.level_in instead"),
        ([ENUMERATION, ("1, 2", '"pink"')], "no value 'pink'; it has red (1), green (2), blue (3)"),
        ([ENUMERATION, ("1, 2", "7")], "the enumeration has no value 7; it has red (1), green (2), blue (3)"),
        ([WHOLE, ("values = [1, 2]", STEPS.format(4))], "expected a value of type Integer, got 2.5"),
        ([("1, 2", '"1 m"')], "'m' does not fit a number without unit: write for example 1"),
        ([("1, 2", '"1 furlong"')], "the unit 'furlong' is not known"),
        ([('"a.gain"', '"a.gain"\nname = "status"')], "'status' is called as a column that all studies have"),
        ([('"a.gain"', '"a.gain"\nname = "active.x"')], "'active.x' is called like the result of a run"),
        (
            [('"a.gain"', '"a.gain"\nname = "b.gain"'), ("[[obs", '[[vary]]\nparameter = "b.gain"\nname = "other"\n'
              "values = [1, 2]\n[[obs")],
            "'b.gain' is called as a start value or seed that the study sets, too: give it a name of its own",
        ),
        ([("b.real_out", "plant.x")], "there is no output 'plant.x'"),
        ([('[[observe]]\nsignal = "b.real_out"', "")], "expected a table with a signal such as a.height, a.real_out"),
        ([("in.csv", "gone.csv")], "inputs: there is no file"),
        ([("seed = 1", 'seed = 1\nextrapolate = "cubic"')], "extrapolate: expected one of hold, linear, smoothed"),
        ([("seed = 1", 'seed = 1\nrates = { a = "2/3" }')], "rates: expected N or 1/N base steps"),
        ([("seed = 1", 'seed = 1\nrates = { x = 2 }')], "there is no component 'x'; expected one of a, b, e"),
        ([("seed = 1", "seed = 1\ntolerance = 1e-3")], "tolerance: is for the scheme 'iterated'"),
        ([("seed = 1", 'seed = 1\nscheme = "iterated"\ntolerance = 2')], "tolerance: expected a number < 1.0, got 2"),
        ([("seed = 1", 'seed = 1\noutside = "yes"')], "outside: expected true or false, got 'yes'"),
    ],
)
def test_what_cannot_be_varied(plan, changes, reason):
    with pytest.raises(StudyError) as error:
        plan(*changes)
    assert reason in str(error.value) and "study.toml" in str(error.value)


@pytest.mark.parametrize(
    ("value", "reason"),
    [
        ('"b.real_in" = 1.0', "is connected to a.real_out: a start value would have no effect"),
        ('"a.real_in" = 1.0', "gets u of the file of inputs: a start value would have no effect"),
        ('"a.real_out" = 1.0', "cannot be set: expected an input or a parameter, its causality is output"),
        ('"e.whole_in" = "pink"', "no value 'pink'; it has red (1), green (2), blue (3)"),
        ('"x.gain" = 1.0', "there is no component 'x'; there are a, b, e"),
    ],
)
def test_what_a_run_cannot_set(plan, value, reason):
    with pytest.raises(StudyError) as error:
        plan(more=f"[runs.active]\n{value}\n")
    assert reason in str(error.value) and "runs.active" in str(error.value)


@pytest.mark.parametrize(
    ("inputs", "reason"),
    [
        ("time,u\n0,1\n1,x\n", r"in\.csv, line 3: input 'u': expected a value of type Real, got 'x'"),
        ("time,b.real_in\n0,1\n", r"in\.csv, line 1: input 'b\.real_in': the variable is connected"),
        ("time,q\n0,1\n", r"in\.csv, line 1: input 'q': there is no such input in the system"),
    ],
)
def test_inputs_that_do_not_fit(plan, inputs, reason):
    with pytest.raises((StudyError, CosimError), match=reason):
        plan(inputs=inputs)


def test_what_can_be_varied(plan):
    """An input of the system leads to its variables; start values of outputs; items and steps of whole numbers."""
    found = plan(('"a.gain"', '["v", "w"]')).plan
    assert found.values(1) == {"a.level_in": 2.0, "b.level_in": 2.0}
    assert plan(("a.gain", "a.height")).plan.values(0) == {"a.height": 1.0}
    assert plan(ENUMERATION, ("1, 2", '"blue", 2')).plan.values(0) == {"e.whole_in": 3}
    values = [plan(WHOLE, ("values = [1, 2]", STEPS.format(3))).plan.values(case)["a.whole_in"] for case in range(3)]
    assert values == [1, 2, 3] and {type(value) for value in values} == {int}
    found = plan(more='[runs.active]\n"e.whole_in" = "green"\n').plan
    assert found.study.runs == {"active": {"e.whole_in": 2}}


def test_a_system_in_a_folder_with_files_outside(plan, tmp_path):
    folder = tmp_path / "folder"
    folder.mkdir()
    (folder / "SystemStructure.ssd").write_text(SYSTEM.replace('"resources/', '"../resources/'))
    with pytest.raises(CosimError, match=r"--outside lets .* elsewhere \(in a study: outside = true\)"):
        plan(("system.ssd", "folder"))
    assert len(plan(("system.ssd", "folder"), ("seed = 1", "seed = 1\noutside = true")).plan) == 2
    with pytest.raises(StudyError, match="system: there is no file"):
        plan(("system.ssd", "resources"))


def test_a_study_in_a_file_with_a_mark_of_its_encoding(write, tmp_path):
    path = write()
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    assert len(prepare(SweepOptions(path, tmp_path / "out")).plan) == 2
    path.write_bytes(path.read_text(encoding="utf-8-sig").encode("utf-16"))
    with pytest.raises(StudyError, match="is not a TOML file: 'utf-8' codec"):
        prepare(SweepOptions(path, tmp_path / "out"))


def test_a_study_is_the_same_in_another_folder(plan, tmp_path):
    """Neither paths, nor comments and lines of the description, nor the dates of files are in its hash."""
    first = plan()
    other = tmp_path / "other"
    shutil.copytree(tmp_path, other, ignore=shutil.ignore_patterns("other"))
    (other / "system.ssd").write_text(SYSTEM.replace("<ssd:Connections>", "<!-- where to -->\n\n<ssd:Connections>"))
    second = prepare(SweepOptions(other / "study.toml", tmp_path / "out"))
    assert second.identity == first.identity


@pytest.mark.parametrize(
    ("what", "reason"),
    [("inputs", "other inputs over time"), ("wiring", "another wiring"), ("conversion", "another wiring")],
)
def test_another_system_is_not_resumed(plan, tmp_path, what, reason):
    first = plan()
    folder = tmp_path / "out"
    folder.mkdir()
    open_folder(folder, first.plan, first.identity, resume=False)
    open_folder(folder, first.plan, first.identity, resume=True)
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    changed = {
        "wiring": SYSTEM.replace(wire("w", "b/level_in"), ""),
        "conversion": SYSTEM.replace(LINEAR, LINEAR.replace('"3"', '"4"')),
    }
    (tmp_path / "system.ssd").write_text(changed.get(what, SYSTEM))
    second = plan(inputs="time,u\n0,1\n1,3\n") if what == "inputs" else plan()
    with pytest.raises(StudyError, match=reason):
        open_folder(folder, second.plan, second.identity, resume=True)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize(
    "change", [{"fmus": 5}, {"fmus": {"ToyRelay": 5}}, {"versions": []}, {"checkpoints_sha256": {"active": None}}, None]
)
def test_a_damaged_manifest_is_named(plan, tmp_path, change):
    prepared, folder = plan(), tmp_path / "out"
    folder.mkdir()
    open_folder(folder, prepared.plan, prepared.identity, resume=False)
    manifest = folder / "manifest.json"
    found = json.loads(manifest.read_text()) | {"plan_sha256": "0"}
    manifest.write_text("[" * 100000 if change is None else json.dumps(found | change))
    with pytest.raises(StudyError, match=re.escape(str(manifest))):
        open_folder(folder, prepared.plan, prepared.identity, resume=True)
    with pytest.raises(StudyError, match=re.escape(str(manifest))):
        read_identity(folder)
