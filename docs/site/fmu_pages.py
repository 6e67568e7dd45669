"""What an FMU says of itself, as sections for the page of its README: icon, capabilities, variables, terminals.

Everything is read from the built FMU, so the page cannot disagree with it.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, fromstring

GROUPS = {
    "input": "Inputs",
    "output": "Outputs",
    "parameter": "Parameters",
    "calculatedParameter": "Calculated parameters",
    "local": "Local variables",
}
COLUMNS = {
    "name": "Name",
    "type": "Type",
    "variability": "Variability",
    "unit": "Unit",
    "start": "Start",
    "min": "Min",
    "max": "Max",
    "description": "Description",
}
ICON = "icon.png"


def write_page(readme: str, fmu: Path, folder: Path) -> str:
    """The page of an FMU, in Markdown: its README with the sections of :func:`describe`, and its icon.

    Parameters
    ----------
    readme: text of the README.
    fmu: the built FMU.
    folder: where the page goes; the icon is written beside it.
    """
    with zipfile.ZipFile(fmu) as archive:
        description = fromstring(archive.read("modelDescription.xml"))
        (folder / ICON).write_bytes(archive.read("model.png"))
        names = archive.namelist()
        terminals = "terminalsAndIcons/terminalsAndIcons.xml"
        wired = fromstring(archive.read(terminals)) if terminals in names else None
    title, _, text = readme.partition("\n")
    icon = f"```{{image}} {ICON}\n:alt: Icon of {description.get('modelName')}\n:class: icon\n```"
    return "\n".join([title, "", icon, text, *describe(description, wired)]) + "\n"


def describe(description: Element, terminals: Element | None) -> Iterator[str]:
    """Lines of Markdown: what it is, what it can do, its variables by causality, its terminals."""
    yield "## Facts"
    yield ""
    yield from _write_table(("Attribute", "Value"), _list_facts(description))
    yield "## Variables"
    yield ""
    yield (
        "Parameters are fixed: they are set before the initialisation ends. Numbers are rounded to six digits; all "
        "digits are in `modelDescription.xml`."
    )
    yield ""
    variables = [_read_variable(variable) for variable in description.iterfind("ModelVariables/ScalarVariable")]
    for causality, title in GROUPS.items():
        group = [variable for variable in variables if variable["causality"] == causality]
        if group:
            columns = [key for key in COLUMNS if any(variable[key] for variable in group)]
            yield f"### {title}"
            yield ""
            yield from _write_table([COLUMNS[key] for key in columns], ([row[key] for key in columns] for row in group))
    if terminals is not None:
        yield "## Terminals"
        yield ""
        rows = (
            (f"`{t.get('name')}`", t.get("description", ""), ", ".join(f"`{m.get('variableName')}`" for m in t))
            for t in terminals.iterfind("Terminals/Terminal")
        )
        yield from _write_table(("Name", "Description", "Variables"), rows)


def _list_facts(description: Element) -> list[tuple[str, str]]:
    facts = [(key, description.get(key, "")) for key in ("modelName", "description", "version", "fmiVersion")]
    facts += [(key, description.get(key, "")) for key in ("generationTool", "variableNamingConvention")]
    experiment = description.find("DefaultExperiment")
    if experiment is not None:
        facts += [(f"default {key}", f"{float(value):g} s") for key, value in experiment.attrib.items()]
    simulation = description.find("CoSimulation")
    if simulation is not None:
        facts += list(simulation.attrib.items())
    return [(f"`{key}`", value) for key, value in facts if value]


def _read_variable(variable: Element) -> dict[str, str]:
    kind = variable[0]
    row = {**dict.fromkeys(COLUMNS, ""), **variable.attrib, **kind.attrib, "type": kind.tag}
    for key in ("start", "min", "max"):
        if row[key] and kind.tag == "Real":
            row[key] = f"{float(row[key]):.6g}"
    return row | {"name": f"`{variable.get('name')}`"}


def _write_table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield "|---" * len(header) + "|"
    for row in rows:
        yield f"| {' | '.join(_escape(cell) for cell in row)} |"
    yield ""


def _escape(cell: str) -> str:
    """A text for a cell; code stays as it is."""
    if cell.startswith("`"):
        return cell.replace("|", "\\|")
    return re.sub(r"([|*_<>$\\\[\]])", r"\\\1", cell)
