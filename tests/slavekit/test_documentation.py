"""The page made from a README and a model description: structure, equations, variables, terminals."""

import re
from xml.etree.ElementTree import fromstring, tostring

import pytest

from ps_fmu.slavekit.author.terminals import Terminal, write_terminals
from ps_fmu.slavekit.pack.launch import write_external_dependencies
from ps_fmu.slavekit.pack.page import write_page

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
