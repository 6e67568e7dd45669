import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from ps_fmu.pointing import indices
from ps_fmu.pointing.interpretation import Interpretation
from ps_fmu.requirements.reading import COMMON, INDICES, OF_STATISTIC, read_requirements
from ps_fmu.requirements.requirement import RequirementError

EXAMPLE = Path(__file__).parents[2] / "system" / "requirements.toml"
NO_QUANTILE = {"statistic": "rms", "probability": None, "interpretation": None}


def test_every_entry_arrives(require):
    signals = ["plant.a.x", "plant.b"]
    found = require(signal=signals, combine="norm", case=["on", "roll*"], settling="50 ms", window="20 ms", at="end")
    assert found.name == "blur"
    assert (found.signals, found.norm, found.cases) == (("plant.a.x", "plant.b"), True, ("on", "roll*"))
    assert (found.settling_s, found.index) == (pytest.approx(0.05), indices.RelativeError(0.02, "end"))
    assert (found.statistic, found.probability, found.confidence) == ("quantile", 0.95, 0.9)
    assert found.interpretation is Interpretation.TEMPORAL
    assert found.limit.to("rad") == pytest.approx(0.5e-6)
    assert [found.judges(case) for case in ("on", "roll0_active", "off")] == [True, True, False]


def test_what_may_be_left_out(require):
    found = require()
    assert (found.norm, found.cases, found.settling_s, found.statistic) == (False, ("active",), 0.0, "quantile")
    assert require(settling="0 s").settling_s == 0.0


@pytest.mark.parametrize("symbol", INDICES)
def test_every_index_with_its_own_entries(require, symbol):
    entries = {"at": None, "window": None, "index": symbol}
    if symbol != "APE":
        entries["window"] = "2 s"
    if symbol == "RPE":
        entries["at"] = "end"
    if symbol in ("PDE", "PRE"):
        entries["separation"] = "10 s"
    found = require(**entries, **NO_QUANTILE)
    assert type(found.index) is INDICES[symbol] and found.index.symbol == symbol
    assert found.about.startswith(symbol) and ("10 s apart" in found.about) == (symbol in ("PDE", "PRE"))
    assert found.level == "RMS, 90 % confidence"


def test_a_peak_has_no_level(require):
    found = require(statistic="peak", probability=None, confidence=None, interpretation=None)
    assert (found.probability, found.confidence, found.level) == (None, None, "peak of the run")


def test_the_indices_are_all_that_the_library_has():
    public = [kind for kind in vars(indices).values() if isinstance(kind, type) and getattr(kind, "symbol", None)]
    assert set(INDICES.values()) == set(public)


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"name": None}, "name: is missing"),
        ({"name": 3}, "name: expected a text of one line, got 3"),
        ({"name": "\x1b[2J"}, "name: expected a text of one line"),
        ({"case": "\x1b[2J"}, "case: expected a name, or a list"),
        ({"signal": []}, "signal: expected a name, or a list"),
        ({"signal": ["a.b", "a.b"]}, "signal: expected a name, or a list of names that differ"),
        ({"index": "APEX"}, "index: expected one of APE, MPE, RPE, PDE, PRE, smear, jitter, got 'APEX'; did you mean"),
        ({"index": "rpe"}, "index: expected one of"),
        ({"index": "MPE"}, "at: unknown for MPE as quantile"),
        ({"at": None}, "at: is missing"),
        ({"at": "middle"}, "at: expected one of uniform, end, got 'middle'"),
        ({"window": 1.0}, "window: expected a number with its unit as a text"),
        ({"window": "1"}, "window: '1' has no unit"),
        ({"window": "1 urad"}, "window: expected a time: 'urad' does not fit the unit 's'"),
        ({"limit": "0.5"}, "limit: '0.5' has no unit"),
        ({"limit": None}, "limit: is missing"),
        ({"limits": "0.5 urad", "limit": None}, "limits: unknown for RPE as quantile; did you mean limit"),
        ({"probability": 1.0}, "probability: expected a number between 0 and 1, got 1.0"),
        ({"probability": 95}, "probability: expected a number between 0 and 1, got 95"),
        ({"probability": "0.95"}, "probability: expected a number between 0 and 1"),
        ({"probability": None}, "probability: is missing"),
        ({"confidence": 0}, "confidence: expected a number between 0 and 1, got 0"),
        ({"confidence": None}, "confidence: is missing"),
        ({"interpretation": None}, "interpretation: is missing"),
        ({"interpretation": "spatial"}, "interpretation: expected one of temporal, ensemble, mixed"),
        ({"statistic": "rms"}, "probability: unknown for RPE as rms"),
        ({"statistic": "mean"}, "statistic: expected one of quantile, rms, peak"),
        ({"statistic": "peak", "probability": None, "interpretation": None}, "confidence: unknown for RPE as peak"),
        ({"combine": "sum"}, "combine: expected one of each, norm"),
        ({"settling": "5"}, "settling: '5' has no unit: write for example '5 s'"),
        ({"settling": 5}, "settling: expected a number with its unit as a text, such as '5 s', got 5"),
        ({"settling": "-1 s"}, "settling: expected a number above 0"),
        ({"settling": "inf s"}, "settling: expected a number with its unit, such as '5 s', got 'inf s'"),
        ({"settling": "0 rad"}, "settling: expected a number above 0"),
        ({"name": "x" * 201}, "name: expected 200 characters at most, got 201"),
        ({"limit": "inf urad"}, "limit: expected a number with its unit, such as '0.5 urad', got 'inf urad'"),
        ({"limit": "-1 urad"}, "limit: expected a number above 0"),
    ],
)
def test_what_is_refused_by_file_line_requirement_and_key(write, change, problem):
    path = write({"name": "first"}, change)
    with pytest.raises(RequirementError) as refused:
        read_requirements(path)
    place = f"{path}, line 11, requirement 2" + (" (blur)" if "name" not in change else "")
    assert str(refused.value).startswith(f"{place}, {problem}")


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("", "there is no requirement in it"),
        ("# nothing\n", "there is no requirement in it"),
        ("requirement = []", "there is no requirement in it"),
        ("[requirement]\nname = 'a'", "expected tables [[requirement]] with two brackets"),
        ("requirement = [1]", "expected tables [[requirement]]"),
        ("[[requirements]]\nname = 'a'", "requirements: unknown; expected tables [[requirement]]"),
        ("[[requirement]]\nname = \n", "not a TOML file: Invalid value (at line 2, column 8)"),
        ("a = " + "[" * 5000, "too deeply"),
    ],
)
def test_files_that_hold_no_requirements(write, text, problem):
    path = write(text=text)
    with pytest.raises(RequirementError) as refused:
        read_requirements(path)
    assert str(refused.value).startswith(f"{path}") and problem in str(refused.value)


def test_a_file_that_cannot_be_read(tmp_path):
    with pytest.raises(RequirementError, match=r"none\.toml: cannot be read: No such file"):
        read_requirements(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(RequirementError, match="not a TOML file"):
        read_requirements(tmp_path / "binary.toml")


@pytest.mark.parametrize("text", ["0 s", "0s", "0.0 ms", " 0 min "])
def test_no_settling_in_any_unit_of_time(require, text):
    assert require(settling=text).settling_s == 0.0


def test_names_in_any_script(require):
    assert require(name="Gr\u00f6\u00dfe der Unsch\u00e4rfe \u2603").name.endswith("\u2603")


def test_names_tell_requirements_apart(write):
    with pytest.raises(RequirementError, match=r"line 11, requirement 2 \(blur\), name: there is another"):
        read_requirements(write({}, {}))


def test_the_examples_of_the_document(write):
    text = (EXAMPLE.parents[1] / "docs" / "requirements.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (documented,) = read_requirements(write(text=example))
    found = read_requirements(EXAMPLE)
    assert replace(documented, place="") == replace(found[0], place="")
    keys = {key for table in tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))["requirement"] for key in table}
    assert {*COMMON, *OF_STATISTIC["quantile"]} == keys - {"window", "at"}
    for key in (*keys, "separation", *INDICES):
        assert f"`{key}`" in text
