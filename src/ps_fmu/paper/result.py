"""What an analysis finds, and how it is written: JSON, Markdown, report.html, pictures."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path

from ..results.report import Picture, Report
from ..results.summary import plain, versions
from ..results.tables import Table
from ..slavekit.pack.files import write_atomically
from . import Published, published


@dataclass(frozen=True)
class Finding:
    """A number of the paper beside ours, in the paper's unit.

    ``computed`` comes from the equations, ``cosimulated`` from the running FMUs; None: not found this way.
    """

    key: str  # of published.toml
    computed: float | None = None
    cosimulated: float | None = None
    remark: str = ""
    setting: bool = False
    """``computed`` is no result but what equations and FMUs are set to."""

    @property
    def published(self) -> Published:
        """What the paper says.  Raises KeyError for a key that published.toml does not have."""
        return published()[self.key]

    @property
    def found(self) -> bool:
        """Whether there is a value of ours."""
        return self.computed is not None or self.cosimulated is not None

    @property
    def difference(self) -> str:
        """Ours against the paper: relative, in percent, for a value; otherwise whether it holds.

        Of the computed and of the co-simulated value, with a slash between them where there are both and they differ.
        """
        ours = [value for value in (self.computed, self.cosimulated) if value is not None]
        if self.setting:
            return "as published" if ours == [self.published.value] else "not as published"
        texts = list(dict.fromkeys(self._against_the_paper(value) for value in ours))
        if len(texts) == 2:
            unit = texts[1].rpartition(" ")[2]
            texts[0] = texts[0].removesuffix(f" {unit}")  # once is enough
        return " / ".join(texts) or "not computed"

    def joined(self, other: Finding) -> Finding:
        """Both as one: the values of either, and both remarks.  Raises ValueError where both have a value."""

        def either(one: float | None, two: float | None) -> float | None:
            if None not in (one, two):
                raise ValueError(f"{self.key}: two analyses find this number; which one belongs into the table?")
            return two if one is None else one

        return Finding(
            self.key,
            either(self.computed, other.computed),
            either(self.cosimulated, other.cosimulated),
            "; ".join(filter(None, (self.remark, other.remark))),
            self.setting or other.setting,
        )

    def _against_the_paper(self, ours: float) -> str:
        said = self.published
        if said.relation == ">":
            return "holds" if ours > said.value else "does not hold"
        if said.relation == "<":
            return "holds" if ours < said.value else "does not hold"
        if said.relation == "~":
            return f"x {ours / said.value:.2g}"
        if said.unit == "%":
            return f"{ours - said.value:+.2g} points"
        if said.value == 0.0 or said.unit in ("deg", "dB"):
            return f"{ours - said.value:+.2g} {said.unit}"
        percent = 100.0 * (ours / said.value - 1.0)
        return f"{percent:+.0f} %" if abs(percent) >= 10.0 else f"{percent:+.2g} %"


FINDINGS_HEADER = (
    "where", "number", "unit", "published", "computed", "co-simulated", "difference: computed / co-simulated", "remark",
)  # fmt: skip


def findings_table(findings: Sequence[Finding], caption: str = "Published and ours") -> Table:
    """Findings as a table under :data:`FINDINGS_HEADER`."""

    def text(value: float | None) -> str:
        return "-" if value is None else f"{value:.6g}"

    rows = [
        (
            f.published.where,
            f.published.what,
            f.published.unit,
            f.published.text,
            f"{text(f.computed)} (input)" if f.setting else text(f.computed),
            "input" if f.setting else text(f.cosimulated),
            f.difference,
            "; ".join(filter(None, (f.published.remark, f.remark))),
        )
        for f in findings
    ]
    return Table(caption, FINDINGS_HEADER, rows)


@dataclass(frozen=True)
class Analysis:
    """The result of one analysis; ``data`` holds whatever else belongs into the JSON file, in SI units."""

    name: str  # of the files
    title: str
    text: Sequence[str]  # paragraphs: what was computed, from which equations, and what it says
    findings: Sequence[Finding] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    data: Mapping[str, object] = field(default_factory=dict)

    def all_tables(self) -> list[Table]:
        """The table of findings, if there are any, and the others."""
        return ([findings_table(self.findings)] if self.findings else []) + list(self.tables)

    def markdown(self) -> str:
        """Text and tables as Markdown."""
        parts = [f"# {self.title}", *self.text, *(table.to_markdown() for table in self.all_tables())]
        parts += [f"![{picture.caption}]({picture.path.name})" for picture in self.pictures]
        return "\n\n".join(parts) + "\n"

    def write(self, output: Path) -> None:
        """Write NAME.json, NAME.md and NAME.html into a folder that exists.  Raises OSError.

        The JSON file has all that the other two show.
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
        write_atomically(output / f"{self.name}.md", self.markdown())
        Report(
            title=self.title,
            text=self.text,
            tables=self.all_tables(),
            pictures=self.pictures,
            versions=versions(),
        ).write(output / f"{self.name}.html")
