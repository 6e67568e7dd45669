"""A number of the paper, the same beside ours, and the table of such findings."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from ..results.tables import Table

RELATIONS = ("=", ">", "<", "~")


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


FINDINGS_HEADER = (
    "where", "number", "unit", "published", "computed", "co-simulated", "difference: computed / co-simulated", "remark",
)  # fmt: skip


def format_value(value: float | None) -> str:
    """A value of a finding as text, ``-`` for None."""
    return "-" if value is None else f"{value:.6g}"


def findings_table(findings: Sequence[Finding], caption: str = "Published and ours") -> Table:
    """The table of findings, one in a row."""

    rows = [
        (
            f.published.where,
            f.published.what,
            f.published.unit,
            f.published.text,
            f"{format_value(f.computed)} (input)" if f.setting else format_value(f.computed),
            "input" if f.setting else format_value(f.cosimulated),
            f.difference,
            "; ".join(filter(None, (f.published.remark, f.remark))),
        )
        for f in findings
    ]
    return Table(caption, FINDINGS_HEADER, rows)


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
    return Table("Published and ours", ("number", "published", "computed", "co-simulated", "difference"), rows)
