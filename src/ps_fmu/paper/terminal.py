"""What an analysis prints: its text and tables, in lines that a terminal can show."""

from __future__ import annotations

import shutil
import textwrap
from collections.abc import Iterator, Sequence

from ..results.report import Table
from .result import Analysis, Finding

NARROWEST, USUAL, WIDEST = 80, 100, 120  # characters of a line; the second where there is no terminal
LONGEST_CELLS = range(60, 16, -4)  # characters, tried in turn; what is longer is broken into lines
GAP = 2


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
        yield f"\n{table.caption} (remarks: {analysis.name}.md)\n{_fitted(table, width)}"
    for table in analysis.tables:
        if (text := _fitted(table, width)) is None:
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


def _fitted(table: Table, width: int) -> str | None:
    """The table with long cells and headings broken into lines; None if it is still too wide."""
    columns = list(zip(*table.rows, strict=True)) or [()] * len(table.header)
    for longest in LONGEST_CELLS:
        widths = [
            max([min(len(cell), longest) for cell in cells] + [len(word) for word in title.split()])
            for title, cells in zip(table.header, columns, strict=True)
        ]
        total = sum(widths) + GAP * (len(widths) - 1)
        if total <= width:
            rows = [line for row in table.rows for line in _broken(row, widths)]
            return "\n".join([*_broken(table.header, widths), "-" * total, *rows])
    return None


def _broken(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row as lines: the first column left-aligned, the others right-aligned."""
    cells = [textwrap.wrap(cell, width) or [""] for cell, width in zip(row, widths, strict=True)]
    height = max(map(len, cells))
    padded = [cell + [""] * (height - len(cell)) for cell in cells]
    return [
        (" " * GAP)
        .join(text.rjust(widths[i]) if i else text.ljust(widths[i]) for i, text in enumerate(line))
        .rstrip()
        for line in zip(*padded, strict=True)
    ]
