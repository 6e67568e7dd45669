"""The page ``documentation/index.html``: README of the FMU's folder, then all variables and terminals.

It needs nothing but a browser: no scripts, no network.  Equations are LaTeX as GitHub shows it, in a line ``$x^2$``, on
their own in a fenced block of the language ``math``; they become MathML, which browsers draw by themselves.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from html import escape
from typing import Any
from xml.etree.ElementTree import Element, ParseError, SubElement, fromstring, tostring

from latex2mathml.converter import convert
from markdown import Markdown, markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor
from markdown.preprocessors import Preprocessor

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

_BLOCK = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)
_INLINE = r"(?<![\\$\w])\$(?!\s)([^$\n]+?)(?<![\s\\])\$(?![$\w])"

# Python-Markdown's own: fenced code has 25 among the preprocessors; backticks 190 and escapes 180 among the patterns.
_BEFORE_FENCED_CODE = 30
_BETWEEN_CODE_AND_ESCAPES = 185

_GROUPS = {"input": "Inputs", "output": "Outputs", "parameter": "Parameters"}
_COLUMNS = {
    "name": "Name", "type": "Type", "unit": "Unit", "displayUnit": "Display unit", "start": "Start", "min": "Min",
    "max": "Max", "nominal": "Nominal", "description": "Description",
}  # fmt: skip
_NUMBERS = ("start", "min", "max", "nominal")


def write_page(readme: str, description: bytes, terminals: bytes | None) -> bytes:
    """Write the page.

    Parameters
    ----------
    readme: Markdown with tables, fenced code and equations.
    description, terminals: the contents of ``modelDescription.xml`` and ``terminalsAndIcons.xml``.

    Raises ValueError for an equation that cannot be converted.
    """
    root = fromstring(description)
    extensions = ["tables", "fenced_code", "sane_lists", _Equations()]
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


def convert_to_mathml(latex: str, display: str) -> str:
    """The element ``math``; ``display`` is ``"block"`` or ``"inline"``.

    Raises ValueError if the converter does not know a part of it: it lets that pass as text.
    """
    text: str = convert(latex, display=display)
    try:
        known = "\\" not in "".join(fromstring(text).itertext())
    except ParseError:
        known = False
    if not known:
        raise ValueError(f"latex2mathml cannot convert this equation: {latex.strip()}")
    return text


class _Equations(Extension):
    def extendMarkdown(self, md: Markdown) -> None:
        md.preprocessors.register(_Blocks(md), "equations", _BEFORE_FENCED_CODE)
        md.inlinePatterns.register(_Inline(_INLINE, md), "equation", _BETWEEN_CODE_AND_ESCAPES)


class _Blocks(Preprocessor):
    def run(self, lines: list[str]) -> list[str]:
        def stored(match: re.Match[str]) -> str:
            place: str = self.md.htmlStash.store(convert_to_mathml(match[1], "block"))
            return f"\n\n{place}\n\n"

        return _BLOCK.sub(stored, "\n".join(lines)).split("\n")


class _Inline(InlineProcessor):
    def handleMatch(self, m: re.Match[str], data: str) -> Any:
        place = self.md.htmlStash.store(convert_to_mathml(m[1], "inline"))
        return place, m.start(0), m.end(0)
