"""The page ``documentation/index.html``: README of the FMU's folder, then all variables and terminals.

It needs nothing but a browser: no scripts, no network, equations as MathML.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from html import escape
from xml.etree.ElementTree import Element, SubElement, fromstring, tostring

from markdown import markdown

from .equations import Equations

_STYLE = """
body { font: 16px/1.5 sans-serif; max-width: 76em; margin: 0 auto 4em; padding: 0 1.5em; color: #222; }
h2 { margin-top: 2em; border-bottom: 1px solid #ccc; }
p, li { max-width: 50em; }
header { color: #555; border-bottom: 1px solid #ccc; padding: .7em 0; }
code { font: .9em monospace; }
pre { background: #f5f5f5; padding: .8em; overflow: auto; }
math { font-size: 1.1em; }
math[display="block"] { margin: 1em 0; max-width: 46em; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9em; }
td, th { border: 1px solid #ccc; padding: .15em .6em; text-align: left; vertical-align: top; }
th { background: #eef4fa; white-space: nowrap; }
td.number { text-align: right; white-space: nowrap; }
"""

_GROUPS = {"input": "Inputs", "output": "Outputs", "parameter": "Parameters"}
_COLUMNS = {
    "name": "Name",
    "type": "Type",
    "unit": "Unit",
    "displayUnit": "Display unit",
    "start": "Start",
    "min": "Min",
    "max": "Max",
    "nominal": "Nominal",
    "description": "Description",
}
_NUMBERS = ("start", "min", "max", "nominal")


def write_page(readme: str, description: bytes, terminals: bytes | None) -> bytes:
    """Write the page.

    Parameters
    ----------
    readme: Markdown with tables, fenced code and equations, see :mod:`.equations`.
    description, terminals: the contents of ``modelDescription.xml`` and ``terminalsAndIcons.xml``.

    Raises ValueError for an equation that cannot be converted.
    """
    root = fromstring(description)
    extensions = ["tables", "fenced_code", "sane_lists", Equations()]
    title = escape(root.get("modelName", ""))
    body = "\n".join(
        [
            f"<header>{_write_facts(root)}</header>",
            markdown(readme, extensions=extensions, output_format="html"),
            *_write_variables(root),
            *([] if terminals is None else _write_terminals(fromstring(terminals))),
        ]
    )
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{title}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    ).encode()


def _write_facts(root: Element) -> str:
    experiment = root.find("DefaultExperiment")
    step = "" if experiment is None else f" &middot; default step {float(experiment.get('stepSize', 'nan')):g} s"
    model, version, fmi = (escape(root.get(name, "")) for name in ("modelName", "version", "fmiVersion"))
    links = {f"#{name.lower()}": name for name in _GROUPS.values()}
    links |= {"externalDependencies.txt": "What it needs", "licenses/license.txt": "Licences"}
    line = " &middot; ".join(f'<a href="{target}">{name}</a>' for target, name in links.items())
    return f"{model} {version} &middot; FMI {fmi} co-simulation{step}<br>{line}"


def _write_variables(root: Element) -> Iterator[str]:
    rows = [_read_row(variable) for variable in root.iterfind("ModelVariables/ScalarVariable")]
    yield '<h2 id="variables">Variables</h2>'
    yield (
        "<p>Parameters are fixed: they are set before the initialisation ends.  Numbers are rounded to six digits; all "
        "digits are in modelDescription.xml.</p>"
    )
    for causality, title in _GROUPS.items():
        group = [row for row in rows if row["causality"] == causality]
        columns = {key: text for key, text in _COLUMNS.items() if any(row[key] for row in group)}
        yield f'<h3 id="{title.lower()}">{title}</h3>'
        yield _write_table(columns, group) if group else "<p>None.</p>"


def _read_row(variable: Element) -> dict[str, str]:
    """A variable's attributes as they are shown."""
    kind = variable[0]
    row = {**dict.fromkeys(_COLUMNS, ""), **variable.attrib, **kind.attrib, "type": kind.tag}
    if kind.tag == "Real":
        row |= {key: f"{float(row[key]):.6g}" for key in _NUMBERS if row[key]}
    return row


def _write_terminals(root: Element) -> Iterator[str]:
    columns = {"name": "Name", "description": "Description", "members": "Variables"}
    rows = [
        {**terminal.attrib, "members": ", ".join(member.get("variableName", "") for member in terminal)}
        for terminal in root.iterfind("Terminals/Terminal")
    ]
    yield '<h2 id="terminals">Terminals</h2>'
    yield (
        "<p>A terminal is wired to that of the same name in another FMU, variable by variable of the same name "
        "(terminalsAndIcons/terminalsAndIcons.xml).</p>"
    )
    yield _write_table(columns, rows)


def _write_table(columns: Mapping[str, str], rows: Iterable[Mapping[str, str]]) -> str:
    frame = Element("div", {"class": "wide"})
    table = SubElement(frame, "table")
    head = SubElement(SubElement(table, "thead"), "tr")
    for title in columns.values():
        SubElement(head, "th").text = title
    body = SubElement(table, "tbody")
    for row in rows:
        line = SubElement(body, "tr")
        for key in columns:
            cell = SubElement(line, "td", {"class": "number"} if key in _NUMBERS else {})
            inside = SubElement(cell, "code") if key == "name" else cell
            inside.text = row[key]
    return tostring(frame, encoding="unicode", method="html").replace("</tr>", "</tr>\n")
