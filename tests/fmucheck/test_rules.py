"""Each rule finds the fault that is made for it, and no other rule does: of descriptions, and of archives."""

import re
import zipfile
from pathlib import Path
from zipfile import ZipFile

import pytest
from fmpy.validation import validate_fmu

from ps_fmu.cosim import SystemFileError
from ps_fmu.fmucheck.reading import read_description
from ps_fmu.fmucheck.rules import DESCRIPTION_RULES, check_description
from ps_fmu.fmucheck.structure_rules import find_archive_problems as find_problems
from ps_fmu.fmucheck.verdicts import FAILED, WARNING

# --- Each rule finds the fault that is made for it, and no other rule does ----------------------------------------

BASE = (Path(__file__).parent / "description.xml").read_text()

INTERFACE = re.search(r"<CoSimulation.*</CoSimulation>", BASE, re.DOTALL)[0]

# Rule, text of the description, what it becomes.
MUTATIONS = [
    ("encoding", ' encoding="UTF-8"', ""),
    ("encoding", "UTF-8", "ISO-8859-1"),
    ("version", 'fmiVersion="2.0"', 'fmiVersion="2.0.4"'),
    ("guid", 'guid="{1}"', 'guid=""'),
    ("date", "2023-02-08T12:30:00Z", "2023-02-08T12:30:00+00:00"),
    ("date", "2023-02-08T12:30:00Z", "2023-02-30T12:30:00Z"),
    ("date", "2023-02-08T12:30:00Z", "2023-2-8T12:30:00Z"),
    ("interface", INTERFACE, ""),
    ("capabilities", 'canGetAndSetFMUstate="true"', ""),
    ("source-files", 'name="b.c"', 'name="a.c"'),
    ("identifier", 'modelIdentifier="Everything"', 'modelIdentifier="every-thing"'),
    ("identifier", 'modelIdentifier="Everything"', 'modelIdentifier="1st"'),
    ("units", '<Unit name="m">', '<Unit name="m"/><Unit name="m">'),
    ("display-units", 'name="cycle"', 'name="other"'),
    ("conversions", 'name="mrad" factor="1e3"', 'name="mrad" factor="0"'),
    ("conversions", 'name="mrad" factor="1e3"', 'name="gon" factor="63.7" offset="none"'),
    ("conversions", '<BaseUnit m="1"/>', '<BaseUnit m="1.0"/>'),
    ("base-units", '<BaseUnit m="1"/>', '<BaseUnit m="1" s="-1"/>'),
    ("base-units", '<BaseUnit m="1"/>', '<BaseUnit m="1" factor="1000"/>'),
    ("base-units", 'name="rpm"><BaseUnit rad="1" s="-1" factor="0.1047198"', 'name="rpm"><BaseUnit rad="1" s="-1"'),
    ("base-units", 'K="1" offset="273.15"', 'K="1" offset="273"'),
    ("display-conversions", 'factor="57.2958"', 'factor="0.0174533"'),
    ("display-conversions", 'name="deg" factor="57.2958"', 'name="deg" factor="57.2958" offset="1"'),
    ("display-conversions", 'name="mrad" factor="1e3"', 'name="mm" factor="1e3"'),
    ("display-conversions", 'offset="32"', 'offset="-459.67"'),
    ("types", "</TypeDefinitions>", '<SimpleType name="Mode"><Enumeration/></SimpleType></TypeDefinitions>'),
    ("types", "</TypeDefinitions>", '<SimpleType name="count"><Integer/></SimpleType></TypeDefinitions>'),
    ("type-units", 'name="Unused"><Real unit="m"', 'name="Unused"><Real unit="gon"'),
    ("type-units", 'name="Unused"><Real unit="m" ', 'name="Unused"><Real '),
    ("type-bounds", 'min="0" max="1"', 'min="0" max="-1"'),
    ("type-bounds", 'max="1" nominal="1"', 'max="one" nominal="1"'),
    ("type-bounds", 'max="1" nominal="1"', 'max="1" nominal="INF"'),
    ("enumerations", '<Item name="on"', '<Item name="off"'),
    ("enumerations", 'name="on" value="2"', 'name="on" value="1"'),
    ("log-categories", 'name="logStatusError"', 'name="logAll"'),
    ("experiment", 'stopTime="10"', 'stopTime="0"'),
    ("experiment", 'stepSize="0.01"', 'stepSize="0"'),
    ("experiment", 'stepSize="0.01"', 'stepSize="11"'),
    ("vendor-annotations", 'name="Two"', 'name="One"'),
    ("experiment", 'tolerance="1e-6"', 'tolerance="small"'),
    ("names", 'name="alias"', 'name="y"'),
    ("names", 'name="alias"', 'name=""'),
    ("derivative-names", 'name="count"', 'name="der(k)"'),
    ("references", 'name="angle" valueReference="2"', 'name="angle" valueReference="4"'),
    ("references", 'valueReference="3"><Real unit="m"', 'valueReference="3"><Real unit="rad"'),
    ("references", 'name="limit" valueReference="9"', 'name="limit" valueReference="7"'),
    ("references", 'valueReference="3"><Real unit="m"', 'valueReference="1" initial="approx"><Real unit="m" start="0"'),
    ("combination", 'causality="parameter" variability="fixed" initial="exact"', 'causality="parameter"'),
    ("combination", 'name="limit" valueReference="9" variability="constant"',
     'name="limit" valueReference="9" variability="constant" causality="parameter"'),
    ("initial", 'name="u" valueReference="1"', 'name="u" valueReference="1" initial="exact"'),
    ("initial", 'variability="fixed" initial="exact"', 'variability="fixed" initial="approx"'),
    ("start", '<Real start="0" unit="m"/>', '<Real unit="m"/>'),
    ("start", 'initial="exact"><Real start="0"/>', 'initial="exact"><Real/>'),
    ("start", 'variability="discrete"><Integer/>', 'variability="discrete"><Integer start="0"/>'),
    ("start", 'causality="independent"><Real/>', 'causality="independent"><Real start="0"/>'),
    ("continuous", 'causality="output" variability="discrete"><Integer/>', 'causality="output"><Integer/>'),
    ("independent", "</ModelVariables>",
     '<ScalarVariable name="t" valueReference="10" causality="independent"><Real/></ScalarVariable></ModelVariables>'),
    ("independent", 'causality="independent"><Real/>', 'causality="independent"><Integer/>'),
    ("finite", 'name="limit" valueReference="9" variability="constant"><Real start="5"',
     'name="limit" valueReference="10" variability="constant"><Real start="INF"'),
    ("values", 'name="limit" valueReference="9" variability="constant"><Real start="5"',
     'name="limit" valueReference="10" variability="constant"><Real start="infinite"'),
    ("values", 'declaredType="Mode" start="1"', 'declaredType="Mode" start="1.5"'),
    ("values", 'max="9" nominal="1"', 'max="9" nominal="0"'),
    ("bounds", 'start="2" min="0"', 'start="2" min="3"'),
    ("bounds", 'declaredType="Angle" start="1"', 'declaredType="Angle" start="5"'),
    ("bounds", '<Real unit="rad" displayUnit="deg" min="-4"', '<Real unit="rad" displayUnit="deg" min="2"'),
    ("declared-type", 'declaredType="Angle"', 'declaredType="Angel"'),
    ("declared-type", 'declaredType="Angle"', 'declaredType="Mode"'),
    ("unit", 'start="0" unit="m"', 'start="0" unit="ft"'),
    ("display-unit", 'displayUnit="deg"', 'displayUnit="gon"'),
    ("display-unit", 'min="0" max="9"', 'min="0" max="9" displayUnit="deg"'),
    ("derivative", 'valueReference="3"><Real unit="m"', 'valueReference="3"><Real unit="m" derivative="10"'),
    ("derivative", 'valueReference="3"><Real unit="m"', 'valueReference="3"><Real unit="m" derivative="99"'),
    ("derivative", 'valueReference="3"><Real unit="m"', 'valueReference="3"><Real unit="m" derivative="6"'),
    ("model-exchange", 'name="u" valueReference="1"',
     'name="u" valueReference="1" canHandleMultipleSetPerTimeInstant="true"'),
    ("model-exchange", 'initial="exact"><Real start="0"/>', 'initial="exact"><Real start="0" reinit="true"/>'),
    ("outputs", '<Unknown index="10" dependencies=""/>', ""),
    ("outputs", '<Unknown index="10" dependencies=""/>', '<Unknown index="10"/><Unknown index="1"/>'),
    ("outputs", '<Unknown index="10" dependencies=""/>', '<Unknown index="10"/><Unknown index="10"/>'),
    ("derivatives", '<Unknown index="7" dependencies="1 2"/>', '<Unknown index="7"/><Unknown index="99"/>'),
    ("initial-unknowns", '<Unknown index="5"/>', ""),
    ("initial-unknowns", '<Unknown index="10"/>', '<Unknown index="10"/><Unknown index="12"/>'),
    ("initial-order", '<Unknown index="5"/>\n      <Unknown index="7"/>', '<Unknown index="7"/><Unknown index="5"/>'),
    ("dependencies", 'dependencies="1 6 8"', 'dependencies="1 6 99"'),
    ("dependencies-known", 'dependencies="1 6 8"', 'dependencies="1 4 6"'),
    ("dependencies-known", '<Unknown index="3" dependencies="1 6"', '<Unknown index="3" dependencies="1 5"'),
    ("dependencies-order", 'dependencies="1 2"', 'dependencies="2 1"'),
    ("dependencies-order", 'dependencies="1 2"', 'dependencies="2 2"'),
    ("dependencies-kind", '"dependent fixed dependent"', '"dependent fixed"'),
    ("dependencies-kind", '"dependent fixed dependent"', '"dependent fixed odd"'),
    ("dependencies-factor", '"constant dependent"', '"fixed dependent"'),
    ("dependencies-factor", '<Unknown index="10" dependencies=""/>',
     '<Unknown index="10" dependencies="1" dependenciesKind="fixed"/>'),
]  # fmt: skip


def broken(text: str) -> list:
    return check_description(read_description(text.encode(), Path("modelDescription.xml")))


def test_the_base_keeps_all_rules(tmp_path):
    """Those of the schema and of FMPy too."""
    with ZipFile(tmp_path / "base.fmu", "w") as archive:
        archive.writestr("modelDescription.xml", BASE)
    assert validate_fmu(str(tmp_path / "base.fmu")) == []
    assert broken(BASE) == []


@pytest.mark.parametrize(("rule", "old", "new"), MUTATIONS)
def test_a_fault_is_found_by_its_rule_alone(rule, old, new):
    assert BASE.count(old) == 1
    problems = broken(BASE.replace(old, new))
    assert {problem.rule.name for problem in problems} == {rule}
    lines = BASE.splitlines()
    assert all(1 <= problem.line <= len(lines) for problem in problems)
    assert str(problems[0]).endswith(f"[{rule}, FMI 2.0.4, section {problems[0].rule.section}]")


def test_the_document_counts_the_rules():
    document = Path(__file__).parents[2] / "fmus" / "README.md"
    assert f"{len(DESCRIPTION_RULES)} rules" in document.read_text().replace("\n", " ")


def test_every_rule_has_a_fault_that_it_finds():
    names = [rule.name for rule in DESCRIPTION_RULES]
    assert len(set(names)) == len(names)
    assert {rule for rule, _, _ in MUTATIONS} == set(names)


def test_our_fmus_keep_all_rules(built_fmus):
    """And more: no two of their variables share a value reference."""
    for path in sorted(built_fmus.glob("*.fmu")):
        description = read_description(ZipFile(path).read("modelDescription.xml"), path)
        assert check_description(description) == []
        references = [variable.reference for variable in description.variables]
        assert len(set(references)) == len(references)


@pytest.mark.parametrize(
    ("old", "new", "verdict", "text"),
    [
        ('dependencies="1 6 8"', 'dependencies="1 4 6"', WARNING,
         "Outputs: unknown 3 (y) depends on k (parameter); there only inputs, the independent variable and "
         "continuous-time states are knowns"),
        ('<Unknown index="10" dependencies=""/>', '<Unknown index="10" dependencies="1" dependenciesKind="constant"/>',
         WARNING, "Outputs: unknown 10 (count): dependenciesKind 'constant' is not allowed: only a Real depends by a "
         "factor, this is of type Integer: expected 'dependent'"),
        ('"constant dependent"', '"fixed dependent"', WARNING,
         "dependenciesKind 'fixed' is not allowed: expected 'dependent' or 'constant' in InitialUnknowns"),
        ('"dependent fixed dependent"', '"dependent fixed odd"', FAILED,
         "dependenciesKind 'odd' is unknown, expected dependent, constant, fixed, tunable, discrete"),
    ],
)  # fmt: skip
def test_dependencies_are_read_strictly_and_the_reason_is_given(old, new, verdict, text):
    (problem,) = broken(BASE.replace(old, new))
    assert problem.rule.verdict == verdict
    assert text in problem.text
    assert str(problem).endswith("FMI 2.0.4, section 2.2.8]")


@pytest.mark.parametrize("text", ["", "<a", "<!DOCTYPE a><a/>"])
def test_what_is_no_description_is_refused(text):
    with pytest.raises(SystemFileError):
        broken(text)


@pytest.mark.parametrize("text", ["<a/>", "<fmiModelDescription/>", BASE.replace(" index=", " place=")])
def test_a_rule_never_stumbles(text):
    assert broken(text)


@pytest.mark.parametrize("value", ["", "-1", "9" * 5000, "NaN", "\u00b2", "1e999", "1 2 x", "&#10;", " 1 ", "1_0"])
def test_no_value_of_an_attribute_makes_a_rule_fail(value):
    """Whatever stands in whichever attribute: problems are found, or there are none."""
    for spot in list(re.finditer(r'(?<==")[^"]*', BASE))[2:]:  # after the XML declaration
        assert all(map(str, broken(BASE[: spot.start()] + value + BASE[spot.end() :])))


def test_many_variables_take_no_time_to_speak_of():
    """10 000 outputs; anything quadratic would be felt at once."""
    numbers = range(1, 10_001)
    variables = "".join(
        f'<ScalarVariable name="y{k}" valueReference="{k}" causality="output"><Real/></ScalarVariable>' for k in numbers
    )
    unknowns = "".join(f'<Unknown index="{k}" dependencies=""/>' for k in numbers)
    text = (
        '<?xml version="1.0" encoding="UTF-8"?>'
        '<fmiModelDescription fmiVersion="2.0" guid="1"><CoSimulation modelIdentifier="Many"/><ModelVariables>'
        f"{variables}</ModelVariables><ModelStructure><Outputs>{unknowns}</Outputs>"
        f"<InitialUnknowns>{unknowns}</InitialUnknowns></ModelStructure></fmiModelDescription>"
    )
    assert broken(text) == []


# --- What makes an archive of an FMU one that every tool can unpack and use ---------------------------------------

DESCRIPTION = read_description(
    b'<fmiModelDescription>'
    b'<CoSimulation modelIdentifier="A"><SourceFiles><File name="a.c"/></SourceFiles></CoSimulation>'
    b'<ModelExchange modelIdentifier="B"/></fmiModelDescription>',
    Path("modelDescription.xml"),
)
NAMES = ("binaries/linux64/A.so", "binaries/linux64/B.so", "sources/a.c")


def written(path: Path, names: tuple[str, ...] = NAMES, method: int = zipfile.ZIP_DEFLATED) -> Path:
    with zipfile.ZipFile(path, "w", method) as archive:
        for name in names:
            archive.writestr(name, "content")
    return path


def test_nothing_is_wrong(tmp_path):
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_STORED):
        assert find_problems(written(tmp_path / "A.fmu", method=method), DESCRIPTION) == []
    assert find_problems(written(tmp_path / "A.fmu", NAMES[:2]), DESCRIPTION) == []  # sources need not be handed on


@pytest.mark.parametrize(
    ("names", "problem"),
    [
        ((*NAMES[:2], "sources/b.c"), "CoSimulation lists the source file a.c, there is no sources/a.c"),
        ((*NAMES, "Sources/A.c"), "sources/a.c and Sources/A.c are one file where case does not matter"),
    ],
)
def test_content(names, problem, tmp_path):
    (found,) = find_problems(written(tmp_path / "A.fmu", names), DESCRIPTION)
    assert found.startswith(problem)


def test_neither_library_nor_sources(tmp_path):
    names = ("binaries/linux64/other.so", "binaries/A.so")
    assert [text for text in find_problems(written(tmp_path / "A.fmu", names), DESCRIPTION) if "neither" in text] == [
        f"there is neither a library binaries/<platform>/{model}.* nor a folder sources" for model in "AB"
    ]


def test_another_suffix(tmp_path):
    assert find_problems(written(tmp_path / "A.zip"), DESCRIPTION) == [
        "the file is named A.zip, expected a name that ends with .fmu"
    ]


def test_another_compression(tmp_path):
    found = find_problems(written(tmp_path / "A.fmu", method=zipfile.ZIP_BZIP2), DESCRIPTION)
    assert "sources/a.c: compression method 12, expected 8 (deflate) or 0 (store)" in found
    assert "sources/a.c: version 4.6 is needed to extract, expected 2.0 at most" in found


def test_sizes_behind_stored_files(tmp_path):
    """As an archive that is written to a pipe has them."""

    class Pipe:
        def __init__(self, file):
            self.write, self.flush = file.write, file.flush

    with (tmp_path / "A.fmu").open("wb") as file, zipfile.ZipFile(Pipe(file), "w") as archive:
        for name in NAMES:
            archive.writestr(name, "content")
    found = find_problems(tmp_path / "A.fmu", DESCRIPTION)
    assert found[-1] == (
        "sources/a.c: stored with its size behind it (general purpose bit 3), allowed only with deflate"
    )
    assert len(found) == len(NAMES)
