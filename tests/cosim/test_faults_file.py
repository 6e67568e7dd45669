"""Files of faults: libcosim's grammar and ours, read strictly; each error has the path of the key."""

import json
import sys

import jsonschema
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ps_fmu.cosim import SystemFileError
from ps_fmu.cosim.faults.reading import SCHEMA, read_faults
from ps_fmu.cosim.structure import PortName

# In the structure of the scenarios that libcosim's own tests read.
LIBCOSIM = """{
  "description": "an override of an output, and a bias of an input",
  "defaults": {"model": "slave uno", "variable": "realOut", "action": "override"},
  "events": [
    {"time": 0.5, "variable": "realIn", "action": "bias", "value": 1.001},
    {"time": 0.2, "value": -1.0},
    {"time": 0.3, "action": "reset"},
    {"time": 0.65, "variable": "intIn", "value": 2}
  ],
  "end": 1.0
}"""
LIBCOSIM_YAML = """---
description: an override of an output, and a bias of an input
defaults:
  model: slave uno
  variable: realOut
  action: override
events:
  - time: 0.5
    variable: realIn
    action: bias
    value: 1.001
  - time: 0.2
    value: -1
  - time: 3e-1
    action: reset
  - time: 0.65
    variable: intIn
    value: 2
end: 1
"""


def write(folder, text, name="faults.json"):
    path = folder / name
    path.write_text(text if isinstance(text, str) else json.dumps(text))
    return path


def event(**more):
    """A file with one event."""
    keys = {"time": 1.0, "model": "a", "variable": "y", "action": "bias", "value": 1.0, **more}
    return {"events": [{key: value for key, value in keys.items() if value != "none"}]}


@pytest.mark.parametrize(("text", "name"), [(LIBCOSIM, "f.json"), (LIBCOSIM, "f.txt"), (LIBCOSIM_YAML, "f.yml")])
def test_scenarios_of_libcosim_are_read_as_they_are(tmp_path, text, name):
    found = read_faults(write(tmp_path, text, name))
    assert found.description == "an override of an output, and a bias of an input" and found.end_s == 1.0
    assert [(e.time_s, e.signal, e.action, e.value) for e in found.events] == [
        (0.5, PortName("slave uno", "realIn"), "bias", 1.001),
        (0.2, PortName("slave uno", "realOut"), "override", -1.0),
        (0.3, PortName("slave uno", "realOut"), "reset", None),
        (0.65, PortName("slave uno", "intIn"), "override", 2),
    ]
    assert isinstance(found.events[3].value, int)


GOOD = [
    event(),
    event(duration=2, joins=True, target="b.u", description="why", name="first_1"),
    event(action="override", value="text"), event(action="override", value=False),
    event(action="scale", value=-1e-3), event(action="freeze", value="none"),
    event(action="dropout", value="none"), event(action="dropout", value=0, probability=0.5, seed=2**53 - 1),
    event(action="delay", value=0), event(action="noise", value="none", rms=0.1, seed=1),
    event(action="noise", value="none", density=1e-9), event(action="reset"), event(action="reset", value="none"),
    {"$schema": "faults.schema.json", "events": []},
]  # fmt: skip
BAD = [
    ([], "the file: expected an object with keys"),
    ({}, "events: is missing"),
    ({"events": {}}, "events: expected a list"),
    ({"events": [], "ends": 1}, "ends: unknown key; did you mean end"),
    ({"events": [], "end": -1}, "end: expected a number >= 0.0, got -1"),
    ({"events": [], "defaults": {"time": 1}}, "defaults.time: unknown key"),
    ({"events": [], "defaults": {"action": "biass"}}, "defaults.action: expected one of .*did you mean bias"),
    ({"events": [1]}, r"events\[0\]: expected an object with keys, got 1"),
    (event(time="none"), r"events\[0\].time: is missing"),
    (event(time=-0.1), r"events\[0\].time: expected a number >= 0.0, got -0.1"),
    (event(time=True), r"events\[0\].time: expected a number, got True"),
    (event(time="1"), r"events\[0\].time: expected a number, got '1'"),
    (event(time=1e301), r"events\[0\].time: expected a number < 1e\+300, got 1e\+301"),
    (event(time=10**400), r"events\[0\].time: number out of range"),
    (event(model="none"), r"events\[0\].model: is missing"),
    (event(variable=3), r"events\[0\].variable: expected a text, got 3"),
    (event(model=""), r"events\[0\].model: expected a text of length >= 1"),
    (event(action="biass"), r"events\[0\].action: expected one of .*, got 'biass'; did you mean bias"),
    (event(action="ramp"), r"events\[0\].action: expected one of override, bias"),
    (event(value="none"), r"events\[0\].value: is missing"),
    (event(value=[1]), r"events\[0\].value: expected .*, got a list"),
    (event(value=None), r"events\[0\].value: expected .*, got nothing"),
    (event(vlaue=1), r"events\[0\].vlaue: unknown key; did you mean value"),
    (event(rms=1), r"events\[0\].rms: unknown key; expected .*value"),
    (event(duration=0), r"events\[0\].duration: expected a number > 0.0, got 0"),
    (event(joins=1), r"events\[0\].joins: expected true or false, got 1"),
    (event(target=None), r"events\[0\].target: expected a text, got nothing"),
    (event(action="freeze"), r"events\[0\].value: unknown key"),
    (event(action="dropout", probability=1.5), r"events\[0\].probability: expected a number <= 1.0, got 1.5"),
    (event(action="dropout", seed=1), r"events\[0\]: seed: expected none without a probability"),
    (event(action="delay", value=-1), r"events\[0\].value: expected a number >= 0.0, got -1"),
    (event(action="delay", value="1"), r"events\[0\].value: expected a number, got '1'"),
    (event(action="noise", value="none"), r"events\[0\]: expected either rms or density"),
    (event(action="noise", value="none", rms=1, density=1), r"events\[0\]: expected either rms or density"),
    (event(action="noise", value="none", rms=1, seed=-1), r"events\[0\].seed: expected a whole number >= 0, got -1"),
    (event(action="noise", value="none", rms=1, seed=0.5), r"events\[0\].seed: expected a whole number, got 0.5"),
    (event(name="a.b"), r"events\[0\].name: expected .*regex.*, got 'a\.b'"),
    (event(name="1st"), r"events\[0\].name: expected .*regex"),
    (event(action="reset", duration=1), r"events\[0\].duration: unknown key"),
]


@pytest.mark.parametrize("content", GOOD)
def test_what_is_right_is_read_and_fits_the_schema(tmp_path, content):
    schema = json.loads(SCHEMA.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    jsonschema.validate(content, schema)
    assert len(read_faults(write(tmp_path, content)).events) == len(content["events"])


# What a schema cannot say: a missing model may be in the defaults.
@pytest.mark.parametrize(("content", "text"), BAD)
def test_what_is_wrong_is_refused_with_its_key(tmp_path, content, text):
    with pytest.raises(SystemFileError, match=rf"faults\.json: {text}"):
        read_faults(write(tmp_path, content))
    if "model: is missing" not in text:
        with pytest.raises(jsonschema.ValidationError):
            jsonschema.validate(content, json.loads(SCHEMA.read_text()))


def test_two_events_have_no_name_in_common(tmp_path):
    named = [{**event()["events"][0], "name": name} for name in ("a", "b", "a")]
    with pytest.raises(SystemFileError, match=r"events\[2\]: name: 'a' is the name of events\[0\], too"):
        read_faults(write(tmp_path, {"events": named}))
    assert [one.name for one in read_faults(write(tmp_path, {"events": named[:2]})).events] == ["a", "b"]


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "is not a JSON file: Expecting value"),
        ('{"events": [\n1,\n]}', "is not a JSON file: .*line 3"),
        ('{"a": 1,\n"a": 2}', "is not a JSON file: the key 'a' occurs twice"),
        ('{"a": NaN}', "is not a JSON file: NaN is not a number"),
        ("[" * 100_000, "nested too deeply"),
    ],
)
def test_broken_json_is_refused(tmp_path, text, reason):
    with pytest.raises(SystemFileError, match=reason):
        read_faults(write(tmp_path, text))


LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{new}: &{new} [{', '.join([f'*{old}'] * 9)}]\n" for old, new in zip("abcdefgh", "bcdefghi", strict=True)
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "the file: expected an object with keys, got nothing"), ("events: [", "is not a YAML file"),
        ("a: 1\na: 2", "is not a YAML file: the key 'a' occurs twice"),
        (LAUGHS, "more than .* 200000 values"), ("a: &a [*a]", "more than 16 lists|unconstructable"),
        ("[" * 2000, "is not a YAML file|nested too deeply"), ("[a]: 1", "line 1: expected a text as key"),
        ("a: !!python/object/apply:os.system [echo]", "a: unknown key"),
        ("events: !!python/name:os.system x", "is not a YAML file"), ("events: 2001-01-01", "events: expected a list"),
        ("events: [{time: .nan, model: a, variable: y, action: freeze}]", r"\[0\]\.time: expected a number"),
    ],
)  # fmt: skip
def test_broken_yaml_is_refused(tmp_path, text, reason):
    with pytest.raises(SystemFileError, match=reason):
        read_faults(write(tmp_path, text, "faults.yaml"))


def test_too_many_events_are_refused(tmp_path):
    with pytest.raises(SystemFileError, match="events: expected a list of length <= 10000"):
        read_faults(write(tmp_path, {"events": [0] * 10_001}))


def test_files_that_cannot_be_read_are_refused(tmp_path):
    with pytest.raises(SystemFileError, match="cannot be read: No such file"):
        read_faults(tmp_path / "none.json")
    with pytest.raises(SystemFileError, match="is a folder"):
        read_faults(tmp_path)
    with pytest.raises(SystemFileError, match="is not a JSON file: 'utf-8' codec"):
        (tmp_path / "latin.json").write_bytes(b'{"a": "\xe9"}')
        read_faults(tmp_path / "latin.json")
    with pytest.raises(SystemFileError, match="at most 4194304 are read"):
        read_faults(write(tmp_path, " " * (4 * 2**20 + 1)))


def test_yaml_without_pyyaml_says_what_to_do(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "yaml", None)
    with pytest.raises(SystemFileError, match=r"YAML needs PyYAML \(pip install 'ps-fmu\[yaml\]'\); JSON"):
        read_faults(write(tmp_path, LIBCOSIM_YAML, "f.yml"))
    assert read_faults(write(tmp_path, LIBCOSIM)).end_s == 1.0


ATOMS = st.one_of(
    st.none(), st.booleans(), st.integers(-3, 3), st.floats(), st.sampled_from(["bias", "freeze", "noise", "a", ""])
)
NAMES = st.sampled_from([
    "time", "model", "variable", "action", "value", "duration", "joins", "rms", "density", "seed", "probability",
    "target", "events", "end", "defaults", "x",
])  # fmt: skip
CONTENT = st.fixed_dictionaries(
    {"events": st.lists(st.fixed_dictionaries({"time": ATOMS}, optional={"x": ATOMS}) | st.dictionaries(NAMES, ATOMS))},
    optional={"end": ATOMS, "defaults": st.dictionaries(NAMES, ATOMS), "x": ATOMS},
)


@given(CONTENT)
@settings(max_examples=100, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_whatever_is_in_it_is_read_and_fits_the_schema_or_is_refused(tmp_path, content):
    try:
        read_faults(write(tmp_path, content))
    except SystemFileError:
        return
    jsonschema.validate(content, json.loads(SCHEMA.read_text()))
