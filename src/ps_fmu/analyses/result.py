"""The result of an analysis, numbers of the paper beside ours, tables, pictures; its files: JSON, Markdown, HTML."""

from __future__ import annotations

import json
import shutil
import textwrap
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from ..files.plain import write_atomically
from ..results.report import Picture, Report, Section
from ..results.style import draw
from ..results.summary import plain, versions
from ..results.tables import USUAL, Table

RELATIONS = ("=", ">", "<", "~")
T = TypeVar("T")

NARROWEST, WIDEST = 80, 120  # characters of a line


@dataclass(frozen=True)
class PublishedNumber:
    """A number of the paper."""

    key: str  # ``group.name``
    where: str  # section, figure or table
    what: str
    unit: str
    value: float
    relation: str = "="
    """``"="``: the paper gives this value; ``">"`` or ``"<"``: it says that the number is above or below; ``"~"``: it
    gives an order of magnitude."""
    remark: str = ""

    def __post_init__(self) -> None:
        if self.relation not in RELATIONS:
            raise ValueError(f"{self.key}: relation {self.relation!r}, expected one of {RELATIONS}")

    @property
    def text(self) -> str:
        """The value with its relation, as in a table."""
        return f"{self.value:g}" if self.relation == "=" else f"{self.relation} {self.value:g}"


@dataclass(frozen=True)
class Finding:
    """A number of the paper beside ours, in the paper's unit."""

    published: PublishedNumber  # the number of the paper
    computed: float | None = None  # from the equations; None: not computed
    cosimulated: float | None = None  # from the running FMUs; None: not measured
    remark: str = ""
    setting: bool = False  # ``computed`` is a setting of equations and FMUs, and not a result

    @property
    def key(self) -> str:
        """Of the published number."""
        return self.published.key

    @property
    def has_value(self) -> bool:
        """Whether the number was computed or measured."""
        return self.computed is not None or self.cosimulated is not None

    @property
    def difference(self) -> str:
        """Our value against the paper's: the difference, or whether the paper's relation holds.

        Where the computed and the co-simulated value differ from it in other ways, both, with a slash between them.
        """
        ours = [value for value in (self.computed, self.cosimulated) if value is not None]
        if self.setting:
            return "as published" if ours == [self.published.value] else "not as published"
        texts = list(dict.fromkeys(self._compare(value) for value in ours))
        if len(texts) == 2:
            unit = texts[1].rpartition(" ")[2]
            texts[0] = texts[0].removesuffix(f" {unit}")  # once is enough
        return " / ".join(texts) or "not computed"

    def join(self, other: Finding) -> Finding:
        """One finding with the values of either and both remarks.  Raises ValueError where both have a value."""

        def either(one: float | None, two: float | None) -> float | None:
            if None not in (one, two):
                raise ValueError(f"{self.key}: two analyses find this number; which one belongs into the table?")
            return two if one is None else one

        return Finding(
            self.published,
            either(self.computed, other.computed),
            either(self.cosimulated, other.cosimulated),
            "; ".join(filter(None, (self.remark, other.remark))),
            self.setting or other.setting,
        )

    def _compare(self, ours: float) -> str:
        paper = self.published
        if paper.relation == ">":
            return "holds" if ours > paper.value else "does not hold"
        if paper.relation == "<":
            return "holds" if ours < paper.value else "does not hold"
        if paper.relation == "~":
            return f"x {ours / paper.value:.2g}"
        if paper.unit == "%":
            return f"{ours - paper.value:+.2g} points"
        if paper.value == 0.0 or paper.unit in ("deg", "dB"):
            return f"{ours - paper.value:+.2g} {paper.unit}"
        percent = 100.0 * (ours / paper.value - 1.0)
        return f"{percent:+.0f} %" if abs(percent) >= 10.0 else f"{percent:+.2g} %"


def format_value(value: float | None) -> str:
    """A value of a finding as text, ``-`` for None."""
    return "-" if value is None else f"{value:.6g}"


def findings_table(findings: Sequence[Finding], caption: str = "Published and computed") -> Table:
    """The table of findings, one in a row."""
    return tabulate(
        caption,
        findings,
        (
            ("where", lambda f: f.published.where),
            ("number", lambda f: f.published.what),
            ("unit", lambda f: f.published.unit),
            ("published", lambda f: f.published.text),
            ("computed", lambda f: format_value(f.computed) + (" (input)" if f.setting else "")),
            ("co-simulated", lambda f: "input" if f.setting else format_value(f.cosimulated)),
            ("difference: computed / co-simulated", lambda f: f.difference),
            ("remark", lambda f: "; ".join(filter(None, (f.published.remark, f.remark)))),
        ),
    )


def short_findings_table(findings: Sequence[Finding]) -> Table:
    """The table of findings for a terminal: without remarks, and with the place only where a new one begins."""
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
    return Table("Published and computed", ("number", "published", "computed", "co-simulated", "difference"), rows)


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
            parts.append(f"\n{table.caption} (remarks: {self.name}.md)\n{table.to_text(width)}")
        for table in self.tables:
            if table.fits(width):
                parts.append(f"\n{textwrap.fill(table.caption, width)}\n{table.to_text(width)}")
            else:
                left_out.append(table.caption)
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
        for table in self.tables:
            heading, _, more = table.caption.partition("; ")
            sections.append(Section(heading, tables=[replace(table, caption=more[:1].upper() + more[1:])]))
        for part in self.parts:
            link = f"{part.name}.html", f"All of this analysis: {part.name}.html"
            sections.append(Section(part.title, pictures=part.pictures, link=link))
        if self.pictures and not self.parts:
            sections.append(Section("Figures", pictures=self.pictures))
        return sections
