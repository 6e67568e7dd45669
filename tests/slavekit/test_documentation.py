"""The page made from a README and a model description; terminals; the example of docs/developers/native-steps.md."""

import importlib.util
import re
from pathlib import Path
from xml.etree.ElementTree import fromstring, tostring

import fmpy
import pytest
from lxml import etree
from support.states import start_stepping

from ps_fmu.slavekit.author import elements
from ps_fmu.slavekit.author.slave import Slave, vector
from ps_fmu.slavekit.author.terminals import Terminal, write_terminals
from ps_fmu.slavekit.pack.launch import write_external_dependencies
from ps_fmu.slavekit.pack.page import write_page

# --- The page made from a README and a model description: structure, equations, variables, terminals --------------

README = r"""# Title & more

A paragraph with `a < b` and [a link](https://example.org/x).

| name | unit |
|------|------|
| `x` | m |

```python
x = "<b>"
```
"""


def shown(readme, description=b'<fmiModelDescription modelName="A &amp; B"/>', terminals=None):
    """The page as elements; browsers read what is XML but for its first lines."""
    text = write_page(readme, description, terminals).decode()
    return fromstring(re.sub(r"<!DOCTYPE html>\n|<meta [^>]*>", "", text).replace("<br>", "").replace("&middot;", ""))


def texts(element, path):
    return ["".join(found.itertext()) for found in element.iterfind(path)]


def maths(readme):
    """The equations of a README, as texts."""
    return ["".join(e.itertext()) for e in shown(readme).iter("{http://www.w3.org/1998/Math/MathML}math")]


@pytest.fixture(scope="module")
def description(toys):
    return tostring(toys["oscillator"](instance_name="o").to_xml())


def test_a_page_has_the_structure_of_its_source():
    root = shown(README)
    body = root.find("body")
    assert [element.tag for element in body][:6] == ["header", "h1", "p", "table", "pre", "h2"]
    assert root.findtext("head/title") == "A & B"
    assert "".join(body[2].itertext()) == "A paragraph with a < b and a link."
    assert ["".join(cell.itertext()) for cell in body[3].iter("td")] == ["x", "m"]
    assert "".join(body[4].itertext()) == 'x = "<b>"\n'


def test_a_page_needs_nothing_from_elsewhere(description):
    text = write_page("$x$ and [a link](https://example.org/x)", description, None).decode()
    for word in ("<script", "<link", "<img", "<iframe", "@import", "url("):
        assert word not in text
    assert re.findall(r'https?://[^"]*', text) == ["http://www.w3.org/1998/Math/MathML", "https://example.org/x"]


def test_equations_are_elements_that_browsers_draw():
    block = "Before\n\n```math\nM \\ddot{q} = \\frac{f_\\text{f}}{2}\n```\nafter $a_1 < b$.\n"
    assert maths(block) == ["Mq¨=ff2", "a1<b"]
    body = shown(block).find("body")
    math = "{http://www.w3.org/1998/Math/MathML}math"
    assert [e.tag for e in body][1:4] == ["p", math, "p"]
    assert [e.get("display") for e in body.iter(math)] == ["block", "inline"]
    assert maths("| a | $b$ |\n|---|---|\n| $c_1$ | $d$ |\n") == ["b", "c1", "d"]


@pytest.mark.parametrize(
    "text", ["`$x$`", "5 $ and 6 $ more", "it is $5", r"\$x\$", "```\n$x$\n```", "```text\n$x$\n```"]
)
def test_what_is_no_equation_stays(text):
    assert maths(text) == []


@pytest.mark.parametrize("latex", [r"\nosuchcommand x", r"\begin{aligned} a &= b \end{aligned}"])
def test_an_equation_that_cannot_be_converted_is_refused(latex):
    with pytest.raises(ValueError, match="cannot convert this equation: .*" + re.escape(latex[-6:])):
        write_page(f"```math\n{latex}\n```", b"<fmiModelDescription/>", None)


def test_all_variables_are_in_the_tables(description, toys):
    body = shown("# Oscillator", description).find("body")
    assert texts(body, "h3") == ["Inputs", "Outputs", "Parameters"]
    tables = [div.find("table") for div in body.iterfind("div")]
    names = [texts(table, "tbody/tr/td/code") for table in tables]
    for shown_names, causality in zip(names, ("input", "output", "parameter"), strict=True):
        assert shown_names == [p.name for p in toys["oscillator"].layout.ports if p.causality == causality]
    assert texts(tables[0], "thead/tr/th") == ["Name", "Type", "Unit", "Start", "Min", "Max", "Description"]
    assert texts(tables[1], "thead/tr/th") == ["Name", "Type", "Unit", "Nominal", "Description"]
    rows = [texts(row, "td") for row in tables[0].iterfind("tbody/tr")]
    assert rows[0] == ["force", "Real", "N", "0", "-100", "100", "Force on the mass"]
    assert rows[3] == ["engage", "Boolean", "", "true", "", "", "Follow the reference"]


def test_terminals_are_listed(description, toys):
    xml = write_terminals([Terminal("motion", ("position", "speed"), "Motion")], toys["oscillator"].layout)
    tables = shown("# Oscillator", description, xml).findall("body/div/table")
    assert texts(tables[-1], "tbody/tr/td") == ["motion", "Motion", "position, speed"]


@pytest.mark.parametrize(
    ("bundled", "words"),
    [
        (False, ("CPython 3.11 or later with numpy and scipy", "PS_FMU_PYTHON", "VIRTUAL_ENV", "libpython")),
        (True, ("CPython with numpy and scipy is in the FMU", "glibc 2.")),
    ],
)
def test_what_an_fmu_needs_of_the_machine(bundled, words):
    text = write_external_dependencies("Oscillator", ["numpy", "scipy"], bundled).decode()
    assert text.startswith("What Oscillator.fmu needs of the machine\n")
    for word in words:
        assert word in text


# --- terminalsAndIcons.xml: valid by the schema of FMI 3.0, which FMI 2.0.4 refers to; only variables that exist --

SCHEMA = Path(fmpy.__file__).parent / "schema" / "fmi3" / "fmi3TerminalsAndIcons.xsd"


class Gripper(Slave):
    """A slave with vectors."""

    ports = (
        *vector("force", "xyz", "N", "Force", causality="input"),
        *vector("force_limit", "xyz", "N", "Limit", causality="parameter"),
        *vector("position", "xy", "m", "Position", causality="output"),
    )


def test_members_are_the_components_in_their_order():
    terminals = [Terminal("grip", ("force",), "Force"), Terminal("motion", ("position", "force.z"), "Motion & more")]
    data = write_terminals(terminals, Gripper.layout)
    etree.XMLSchema(etree.parse(str(SCHEMA))).assertValid(etree.fromstring(data))
    root = fromstring(data)
    assert root.get("fmiVersion") == "3.0"
    found = {
        terminal.get("name"): [member.attrib for member in terminal] for terminal in root.iterfind("Terminals/Terminal")
    }
    assert [member["variableName"] for member in found["grip"]] == ["force.x", "force.y", "force.z"]
    assert [member["memberName"] for member in found["motion"]] == ["position.x", "position.y", "force.z"]
    assert {member["variableKind"] for members in found.values() for member in members} == {"signal"}
    assert {terminal.get("matchingRule") for terminal in root.iter("Terminal")} == {"plug"}


def test_a_member_that_does_not_exist_is_named():
    with pytest.raises(KeyError, match=r"there is no variable 'torque'.* in Gripper"):
        write_terminals([Terminal("grip", ("torque",), "")], Gripper.layout)


# --- The example of docs/developers/native-steps.md runs, and does what its sentence says ----------------------------

H = 0.02  # s
PAGE = Path(__file__).parents[2] / "docs" / "developers" / "native-steps.md"


@pytest.fixture
def sensor(tmp_path):
    script = tmp_path / "level_sensor.py"
    script.write_text(re.findall(r"```python\n(.*?)```", PAGE.read_text(), re.DOTALL)[0])
    spec = importlib.util.spec_from_file_location("level_sensor", script)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    slave = module.LevelSensor(instance_name="sensor")
    start_stepping(slave)
    return slave


def test_the_sensor_is_sampled_rounded_and_late(sensor):
    found = []
    for k in range(40):
        sensor.set_real([sensor.layout.find("level")], [0.0123 * k])
        sensor.do_step(k * H, H)
        found.append(sensor.y[0])
    sampled = [round(0.0123 * (k - (k + 1) % 5) / 0.01) * 0.01 if k >= 4 else 0.0 for k in range(40)]
    assert found == pytest.approx([0.0] * 10 + sampled[:-10], abs=1e-15)


def test_all_elements_are_in_the_table():
    names = {name for name, value in vars(elements).items() if isinstance(value, type)}
    names = {name for name in names if issubclass(getattr(elements, name), elements.Element)} - {"Element"}
    table = PAGE.read_text().split("| element | does |")[1].split("\n\n")[0]
    assert set(re.findall(r"`(\w+)`", table)) == names
