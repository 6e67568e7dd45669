import math
import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from support.claims import verify_claim

from ps_fmu.pointing import indices
from ps_fmu.pointing.interpretation import Interpretation
from ps_fmu.requirements.quantity import parse_limit, parse_quantity
from ps_fmu.requirements.requirement import INDICES, RequirementError, read_requirements

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
        ({"name": None}, "requirement[1].name: is missing"),
        ({"name": 3}, "requirement[1].name: expected a text of one line, got 3"),
        ({"name": "\x1b[2J"}, "requirement[1].name: expected a text of one line"),
        ({"name": "x" * 201}, "requirement[1]: name: expected 200 characters at most, got 201"),
        ({"case": "\x1b[2J"}, "requirement[1].case: expected a name, or a list of names that differ, got '\\x1b[2J'"),
        ({"signal": []}, "requirement[1].signal: expected a name, or a list"),
        ({"signal": ["a.b", "a.b"]}, "requirement[1].signal: expected a name, or a list of names that differ"),
        ({"index": "APEX"}, "index: expected one of APE, MPE, PDE, PRE, RPE, jitter, smear, got 'APEX'; did you mean"),
        ({"index": "MPE"}, "requirement[1]: at: unknown for MPE as quantile"),
        ({"at": None}, "requirement[1]: at: is missing for RPE as quantile"),
        ({"at": "middle"}, "requirement[1].at: expected one of end, uniform, got 'middle'"),
        ({"window": 1.0}, "window: a number without unit does not fit the unit 's': write for example '1 s'"),
        ({"window": "1 urad"}, "requirement[1].window: 'urad' does not fit the unit 's'"),
        ({"limit": "0.5"}, "requirement[1].limit: '0.5' has no unit: write for example '0.5 urad', or '0.5 1'"),
        ({"limit": None}, "requirement[1].limit: is missing"),
        ({"limits": "0.5 urad"}, "requirement[1].limits: unknown key; did you mean limit"),
        ({"limit": "inf urad"}, "limit: expected a number with its unit, such as '0.5 kg', got 'inf urad'"),
        ({"limit": "-1 urad"}, "limit: expected a number above 0"),
        ({"probability": 1.0}, "requirement[1].probability: expected a number < 1.0"),
        ({"probability": "0.95"}, "requirement[1].probability: expected a number, got '0.95'"),
        ({"probability": None}, "probability: is missing"),
        ({"confidence": 0}, "requirement[1].confidence: expected a number > 0.0"),
        ({"confidence": None}, "confidence: is missing"),
        ({"interpretation": None}, "interpretation: is missing"),
        ({"interpretation": "spatial"}, "interpretation: expected one of temporal, ensemble, mixed, got 'spatial'"),
        ({"statistic": "rms"}, "probability: unknown for RPE as rms"),
        ({"statistic": "mean"}, "statistic: expected one of peak, quantile, rms, got 'mean'"),
        ({"statistic": "peak", "probability": None, "interpretation": None}, "confidence: unknown for RPE as peak"),
        ({"combine": "sum"}, "combine: expected one of each, norm, got 'sum'"),
        ({"settling": "-1 s"}, "settling: expected a time of at least 0 s, got '-1 s'"),
        ({"settling": "0 rad"}, "settling: 'rad' does not fit the unit 's'"),
    ],
)
def test_what_is_refused_by_file_requirement_and_key(write, change, problem):
    path = write({"name": "first"}, change)
    with pytest.raises(RequirementError) as refused:
        read_requirements(path)
    assert str(refused.value).startswith(f"{path}: requirement[1]") and problem in str(refused.value)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("# nothing\n", "there is no requirement in it"),
        ("requirement = []", "there is no requirement in it"),
        ("[requirement]\nname = 'a'", "requirement: expected a list, got an object"),
        ("requirement = [1]", "requirement[0]: expected an object with keys, got 1"),
        ("[[requirements]]\nname = 'a'", "requirements: unknown key; did you mean requirement"),
        ("[[requirement]]\nname = \n", "is not a TOML file: Invalid value (at line 2, column 8)"),
        ("a = " + "[" * 5000, "too deeply"),
        (b"\xff\xfe\x00", "is not a TOML file"),
        (None, "cannot be read: No such file"),
    ],
)
def test_files_that_hold_no_requirements(tmp_path, text, problem):
    path = tmp_path / "required.toml"
    if text is not None:
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RequirementError) as refused:
        read_requirements(path)
    assert str(refused.value).startswith(f"{path}") and problem in str(refused.value)


@pytest.mark.parametrize("text", ["0 s", "0s", "0.0 ms", " 0 min "])
def test_no_settling_in_any_unit_of_time(require, text):
    assert require(settling=text).settling_s == 0.0


def test_names_in_any_script(require):
    assert require(name="Gr\u00f6\u00dfe der Unsch\u00e4rfe \u2603").name.endswith("\u2603")


def test_names_tell_requirements_apart(write):
    with pytest.raises(RequirementError, match=r"line 11, requirement\[1\] \(blur\), name: there is another"):
        read_requirements(write({}, {}))


def test_the_examples_of_the_document(write):
    text = (EXAMPLE.parents[1] / "docs" / "requirements.md").read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (documented,) = read_requirements(write(text=example))
    found = read_requirements(EXAMPLE)
    assert replace(documented, place="") == replace(found[0], place="")
    keys = {key for table in tomllib.loads(EXAMPLE.read_text(encoding="utf-8"))["requirement"] for key in table}
    for key in (*keys, "separation", *INDICES):
        assert f"`{key}`" in text


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("0.5 urad", "rad", 0.5e-6),
        ("0.5urad", "rad", 0.5e-6),
        (" 5e-1  urad ", "rad", 0.5e-6),
        (".1 arcsec", "rad", 0.1 * math.radians(1.0) / 3600.0),
        ("3 mas", "rad", 3e-3 * math.radians(1.0) / 3600.0),
        ("1 arcsec", "mas", 1000.0),
        ("1 mas", "uas", 1000.0),
        ("1 mas", "nrad", 4.848136811095359),
        ("1 arcmin", "deg", 1.0 / 60.0),
        ("1 deg", "arcmin", 60.0),
        ("1 mrad", "urad", 1000.0),
        ("1 urad", "nrad", 1000.0),
        ("2 mas/s", "rad/s", 2.0 * 4.848136811095359e-9),
        ("20 ms", "s", 0.02),
        ("2 um", "m", 2e-6),
        ("3 mrad/s", "rad/s", 3e-3),
        ("1 rad", "deg", math.degrees(1.0)),
        ("5 %", "1", 0.05),
        ("2 1", "", 2.0),
        ("2 1", "-", 2.0),
    ],
)
def test_values_in_other_units(text, unit, value):
    verify_claim(
        "requirement.units",
        claim="Limits and values in other units",
        where="`ps-fmu run --requirements`, `judge`, `sweep`: all tables",
        reference="the units' definitions",
        error=abs(parse_quantity(text).to(unit) / value - 1.0),
        bound=1e-14,
    )


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        (0.5, "0.5 has no unit: write for example '0.5 urad'"),
        (True, "expected a number with its unit"),
        (["0.5 urad"], "expected a number with its unit"),
        ("urad", "expected a number with its unit"),
        ("", "expected a number with its unit"),
        ("1 2 urad", "the unit '2 urad' is not known"),
        ("0.5 furlong", "the unit 'furlong' is not known; known are"),
        ("0.5 arcsecs", "the unit 'arcsecs' is not known; did you mean arcsec"),
        ("0.5 mrads", "the unit 'mrads' is not known; did you mean mrad"),
        ("20 degC", "the unit 'degC' is not known"),
        ("0 urad", "expected a number above 0"),
        ("-1 urad", "expected a number above 0"),
        ("1e400 rad", "expected a finite number"),
        ("1e-60 rad", "expected a number above 0"),
        ("nan rad", "expected a number with its unit"),
    ],
)
def test_limits_that_are_refused(text, problem):
    with pytest.raises(ValueError) as refused:
        parse_limit(text)
    assert problem in str(refused.value)


@pytest.mark.parametrize(("text", "unit"), [("1 urad", "m"), ("1 ms", "rad"), ("1 urad", "dB"), ("1 m", "kg.m")])
def test_units_that_do_not_fit(text, unit):
    with pytest.raises(ValueError, match=f"'{unit}'"):
        parse_quantity(text).to(unit)
