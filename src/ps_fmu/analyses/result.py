"""The result of an analysis, and its files: JSON, Markdown and HTML."""

from __future__ import annotations

import json
import shutil
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TypeVar

from ..results.report import Picture, Report, Section
from ..results.style import draw
from ..results.summary import plain, versions
from ..results.tables import Table
from ..slavekit.pack.files import write_atomically
from .finding import Finding, findings_table, short_findings_table

T = TypeVar("T")

NARROWEST, USUAL, WIDEST = 80, 100, 120  # characters of a line; the second where there is no terminal


def tabulate(caption: str, items: Iterable[T], columns: Sequence[tuple[str, Callable[[T], str]]]) -> Table:
    """A table with a row for each item; of each column the heading, and what makes the text of an item."""
    rows = [tuple(text(item) for _, text in columns) for item in items]
    return Table(caption, tuple(heading for heading, _ in columns), rows)


Figure = tuple[str, str, tuple[float, float], Callable[..., None], *tuple[object, ...]]
"""Name, caption, width and height in inches, what paints it on a figure of matplotlib, and its other arguments."""


def paint_pictures(folder: Path, prefix: str, *figures: Figure) -> list[Picture]:
    """Paint figures to PREFIX_NAME.png in a folder, to PREFIX.png without a name.  Raises OSError."""
    pictures = []
    for name, caption, size, paint, *data in figures:
        path = folder / ("_".join(filter(None, (prefix, name))) + ".png")
        draw(path, *size, lambda figure, paint=paint, data=data: paint(figure, *data))  # type: ignore[misc]
        pictures.append(Picture(path, caption))
    return pictures


@dataclass(frozen=True)
class AnalysisResult:
    """The result of an analysis."""

    name: str  # of the analysis and of its files
    title: str
    text: Sequence[str]  # paragraphs: what was computed, by which equations, and what follows
    findings: Sequence[Finding] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    parts: Sequence[AnalysisResult] = ()
    """Results that this one puts together, with files of their own beside; ``pictures`` has all of theirs."""
    data: Mapping[str, object] = field(default_factory=dict)  # further entries of the JSON file, in SI units

    def all_tables(self) -> list[Table]:
        """The table of findings, if there are any, and the others."""
        return ([findings_table(self.findings)] if self.findings else []) + list(self.tables)

    def to_markdown(self) -> str:
        """Text and tables as Markdown."""
        more = [f"{part.title}: more in [{part.name}.md]({part.name}.md)." for part in self.parts]
        parts = [f"# {self.title}", *self.text, *more, *(table.to_markdown() for table in self.all_tables())]
        parts += [f"![{picture.caption}]({picture.path.name})" for picture in self.pictures]
        return "\n\n".join(parts) + "\n"

    def to_text(self, width: int | None = None) -> str:
        """Text, findings and tables in lines of at most ``width`` characters, by default those of the terminal.

        Findings are without their remarks, and of tables that are too wide only the captions are named: the Markdown
        file has all of it.
        """
        width = width or min(max(shutil.get_terminal_size((USUAL, 24)).columns, NARROWEST), WIDEST)
        more = [f"{part.title}: more in {part.name}.md." for part in self.parts]
        parts = [self.title, *(textwrap.fill(paragraph, width) for paragraph in (*self.text, *more))]
        left_out = []
        if self.findings:
            table = short_findings_table(self.findings)
            parts.append(f"\n{table.caption} (remarks: {self.name}.md)\n{table.fit_text(width)}")
        for table in self.tables:
            if (text := table.fit_text(width)) is None:
                left_out.append(table.caption)
            else:
                parts.append(f"\n{textwrap.fill(table.caption, width)}\n{text}")
        if left_out:
            parts.append(f"\nIn {self.name}.md:")
            parts += [textwrap.fill(f"- {caption}", width, subsequent_indent="  ") for caption in left_out]
        return "\n".join(parts)

    def write(self, output: Path) -> None:
        """Write NAME.json, NAME.md and NAME.html into a folder that exists.  Raises OSError.

        The JSON file holds everything that the other two show.
        """
        findings = [
            {
                "key": f.key, "where": f.published.where, "what": f.published.what, "unit": f.published.unit,
                "published": f.published.value, "relation": f.published.relation,
                "computed": f.computed, "cosimulated": f.cosimulated, "setting": f.setting,
                "difference": f.difference, "remark": f.remark,
            }
            for f in self.findings
        ]  # fmt: skip
        shown = {
            "analysis": self.name,
            "title": self.title,
            "text": self.text,
            "findings": findings,
            "tables": [asdict(table) for table in self.tables],
            "pictures": [{"file": picture.path.name, "caption": picture.caption} for picture in self.pictures],
        }
        content = plain({**shown, **self.data, "versions": versions()}, self.name)
        write_atomically(output / f"{self.name}.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
        write_atomically(output / f"{self.name}.md", self.to_markdown())
        Report(
            title=self.title,
            text=self.text,
            sections=self._list_sections(),
            versions=versions(),
        ).write(output / f"{self.name}.html")

    def _list_sections(self) -> list[Section]:
        """What the page shows under headings: numbers, other tables, figures, by analysis where there are several."""
        sections = []
        if self.findings:
            sections.append(Section("The paper's numbers", tables=[findings_table(self.findings)]))
        sections += [Section(table.caption.partition(";")[0], tables=[table]) for table in self.tables]
        for part in self.parts:
            link = f"{part.name}.html", f"All of this analysis: {part.name}.html"
            sections.append(Section(part.title, pictures=part.pictures, link=link))
        if self.pictures and not self.parts:
            sections.append(Section("Figures", pictures=self.pictures))
        return sections
