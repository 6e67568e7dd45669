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
    "range": "Range",
    "description": "Description",
}
USUAL = {"type": "Real", "variability": "continuous"}  # a column of nothing else is left out
LEAST = 4  # parameters of a table of their own
ICON = "icon.png"


def write_page(readme: str, fmu: Path, folder: Path, component: str) -> str:
    """The page of an FMU, in Markdown: its README with the sections of :func:`describe`, and its icon.

    Parameters
    ----------
    readme: text of the README.
    fmu: the built FMU.
    folder: where the page goes; the icon is written beside it.
    component: name of the FMU in the systems of ps_fmu.
    """
    with zipfile.ZipFile(fmu) as archive:
        description = fromstring(archive.read("modelDescription.xml"))
        (folder / ICON).write_bytes(archive.read("model.png"))
        names = archive.namelist()
        terminals = "terminalsAndIcons/terminalsAndIcons.xml"
        wired = fromstring(archive.read(terminals)) if terminals in names else None
    title, _, text = readme.partition("\n")
    icon = f"```{{image}} {ICON}\n:alt: Icon of {description.get('modelName')}\n:class: icon\n```"
    return "\n".join([title, "", icon, text, *describe(description, wired, component)]) + "\n"


def describe(description: Element, terminals: Element | None, component: str) -> Iterator[str]:
    """Lines of Markdown: what it is, what it can do, its variables by causality, its terminals."""
    yield "## Facts"
    yield ""
    yield from _write_table(("Attribute", "Value"), _list_facts(description))
    yield "## Variables"
    yield ""
    yield (
        f"Parameter files, requirements and `--observe` take these names; the FMU has them without `{component}.` "
        "Parameters are fixed: set them before the initialisation ends. A table without type or variability has "
        "continuous Reals. Numbers are rounded to six digits; `modelDescription.xml` has all digits."
    )
    yield ""
    variables = [
        _read_variable(variable, component) for variable in description.iterfind("ModelVariables/ScalarVariable")
    ]
    for causality, title in GROUPS.items():
        rows = [variable for variable in variables if variable["causality"] == causality]
        tables = _group(rows) if causality == "parameter" else {"": rows}
        if rows:
            yield from (f"### {title}", "")
        for name, group in tables.items():
            columns = [key for key in COLUMNS if any(row[key] not in ("", USUAL.get(key)) for row in group)]
            yield from (f"#### {name}", "") if name else ()
            yield from _write_table([COLUMNS[key] for key in columns], ([row[key] for key in columns] for row in group))
    if terminals is not None:
        yield "## Terminals"
        yield ""
        rows = (
            (f"`{t.get('name')}`", t.get("description", ""), ", ".join(f"`{m.get('variableName')}`" for m in t))
            for t in terminals.iterfind("Terminals/Terminal")
        )
        yield from _write_table(("Name", "Description", "Variables"), rows)


def _group(rows: Sequence[dict[str, str]]) -> dict[str, list[dict[str, str]]]:
    """Parameters by the first part of their names without its number; few of a kind are among the others."""
    kinds = [re.match(r"`\w+\.(.*?)(_\d+)?[.`]", row["name"])[1] for row in rows]  # type: ignore[index]  # it always matches
    names = [kind if kinds.count(kind) >= LEAST else "Others" for kind in kinds]
    order = sorted(set(names), key=lambda name: (name == "Others", names.index(name)))
    return {name: [row for row, kind in zip(rows, names, strict=True) if kind == name] for name in order}


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


def _read_variable(variable: Element, component: str) -> dict[str, str]:
    kind = variable[0]
    row = {**dict.fromkeys((*COLUMNS, "min", "max"), ""), **variable.attrib, **kind.attrib, "type": kind.tag}
    for key in ("start", "min", "max"):
        if row[key] and kind.tag == "Real":
            row[key] = f"{float(row[key]):.6g}"
    ends = [row["min"] and f"{row['min']} or more", row["max"] and f"{row['max']} or less"]
    row["range"] = f"{row['min']} to {row['max']}" if all(ends) else "".join(ends)
    variability = "" if row["causality"] == "parameter" else row["variability"]
    return row | {"name": f"`{component}.{variable.get('name')}`", "variability": variability}


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
