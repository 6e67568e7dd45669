"""What an analysis prints: its text and tables, in lines that a terminal can show."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator, Sequence

from ..results.tables import Table
from .result import Analysis, Finding

NARROWEST, USUAL, WIDEST = 80, 100, 120  # characters of a line; the second where there is no terminal


def printed(analysis: Analysis, width: int | None = None) -> str:
    """Text, findings and tables in lines of at most ``width`` characters (by default that of the terminal).

    Findings without their remarks; tables that are too wide only by name: the Markdown file has both.
    """
    width = width or min(max(shutil.get_terminal_size((USUAL, 24)).columns, NARROWEST), WIDEST)
    text = (textwrap.fill(paragraph, width) for paragraph in analysis.text)
    return "\n".join([analysis.title, *text, *_tables(analysis, width)])


def _tables(analysis: Analysis, width: int) -> Iterator[str]:
    left_out = []
    if analysis.findings:
        table = _findings(analysis.findings)
        yield f"\n{table.caption} (remarks: {analysis.name}.md)\n{table.fit_text(width)}"
    for table in analysis.tables:
        if (text := table.fit_text(width)) is None:
            left_out.append(table.caption)
        else:
            yield "\n" + textwrap.fill(table.caption, width) + "\n" + text
    if left_out:
        yield f"\nIn {analysis.name}.md:"
        yield from (textwrap.fill(f"- {caption}", width, subsequent_indent="  ") for caption in left_out)


def _findings(findings: Sequence[Finding]) -> Table:
    """The columns with numbers; unit and number in one, after the place where that is a new one."""

    def text(value: float | None) -> str:
        return "-" if value is None else f"{value:.6g}"

    places = ["", *(f.published.where for f in findings)]
    rows = [
        (
            ("" if f.published.where == before else f"{f.published.where}: ")
            + f"{f.published.what} ({f.published.unit})",
            f.published.text,
            text(f.computed),
            "input" if f.setting else text(f.cosimulated),
            f.difference,
        )
        for f, before in zip(findings, places, strict=False)
    ]
    return Table("Published and ours", ("number", "published", "computed", "co-simulated", "difference"), rows)
