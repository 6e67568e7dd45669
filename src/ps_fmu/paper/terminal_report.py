"""The text and the tables of an analysis in lines that fit a terminal."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator, Sequence

from ..results.tables import Table
from .analysis_result import AnalysisResult
from .finding import Finding, format_value

NARROWEST, USUAL, WIDEST = 80, 100, 120  # characters of a line; the second where there is no terminal


def format_result(result: AnalysisResult, width: int | None = None) -> str:
    """Text, findings and tables in lines of at most ``width`` characters (by default that of the terminal).

    Findings without their remarks; tables that are too wide only by name: the Markdown file has both.
    """
    width = width or min(max(shutil.get_terminal_size((USUAL, 24)).columns, NARROWEST), WIDEST)
    text = (textwrap.fill(paragraph, width) for paragraph in result.text)
    return "\n".join([result.title, *text, *_tables(result, width)])


def _tables(result: AnalysisResult, width: int) -> Iterator[str]:
    left_out = []
    if result.findings:
        table = _findings(result.findings)
        yield f"\n{table.caption} (remarks: {result.name}.md)\n{table.fit_text(width)}"
    for table in result.tables:
        if (text := table.fit_text(width)) is None:
            left_out.append(table.caption)
        else:
            yield "\n" + textwrap.fill(table.caption, width) + "\n" + text
    if left_out:
        yield f"\nIn {result.name}.md:"
        yield from (textwrap.fill(f"- {caption}", width, subsequent_indent="  ") for caption in left_out)


def _findings(findings: Sequence[Finding]) -> Table:
    """The columns with numbers; unit and number in one, after the place where that is a new one."""

    places = ["", *(f.published.where for f in findings)]
    rows = [
        (
            ("" if f.published.where == before else f"{f.published.where}: ")
            + f"{f.published.what} ({f.published.unit})",
            f.published.text,
            format_value(f.computed),
            "input" if f.setting else format_value(f.cosimulated),
            f.difference,
        )
        for f, before in zip(findings, places, strict=False)
    ]
    return Table("Published and ours", ("number", "published", "computed", "co-simulated", "difference"), rows)
