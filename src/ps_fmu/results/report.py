"""report.html: one file with the results, figures and origin of a run, to be read, explored and passed on as it is.

Pictures, data and scripts are embedded, nothing is fetched from elsewhere, and every text is escaped.
"""

from __future__ import annotations

import base64
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path

from markupsafe import Markup

from ..files.plain import write_atomically
from .page.content import Exploration, VerdictRow
from .page.writer import render_page
from .summary import FmuFile
from .tables import Table

HOW_TO_ZOOM = (
    "Drag across a chart, or use Ctrl and wheel, two fingers, or the buttons to zoom; double click shows everything."
)


@dataclass(frozen=True)
class Picture:
    """A PNG file with the caption that explains it."""

    path: Path
    caption: str


@dataclass(frozen=True)
class Section:
    """A part of a report under a heading of its own; reports with sections have a table of contents."""

    title: str
    text: Sequence[str] = ()
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    link: tuple[str, str] | None = None  # address, relative to the report, and what it says


@dataclass(frozen=True)
class Report:
    """What a report shows, in this order."""

    title: str
    verdicts: Sequence[VerdictRow] = ()
    text: Sequence[str] = ()  # paragraphs: what was run, and how to read it
    warnings: Sequence[str] = ()  # unconnected inputs, statuses, saturation
    tables: Sequence[Table] = ()
    explored: Exploration = Exploration()  # charts, clouds of points, the mechanism
    pictures: Sequence[Picture] = ()
    sections: Sequence[Section] = ()
    parameters: Mapping[str, object] = field(default_factory=dict)  # options and changed parameters
    fmus: Sequence[FmuFile] = ()
    versions: Mapping[str, str] = field(default_factory=dict)

    def html(self) -> str:
        """The page.  Raises ``OSError`` if a picture cannot be read, ``ValueError`` for arrays that do not fit."""
        shown = {
            "report": self,
            "tables": [Markup(table.to_html()) for table in self.tables],
            "pictures": [_embed(picture) for picture in self.pictures],
            "sections": [_show_section(k, section) for k, section in enumerate(self.sections, 1)],
            "origin": [Markup(table.to_html()) for table in self._tabulate_origin()],
            "how_to_zoom": HOW_TO_ZOOM,
            "written": datetime.now(UTC).isoformat(sep=" ", timespec="seconds"),
        }
        return render_page(shown, self.explored.pack())

    def write(self, path: Path) -> None:
        """Write the page in one go; raises ``OSError`` and leaves what was there if that fails."""
        write_atomically(path, self.html())

    def _tabulate_origin(self) -> Iterator[Table]:
        if self.parameters:
            rows = [(name, str(value)) for name, value in self.parameters.items()]
            yield Table("Parameters of this run", ("parameter", "value"), rows)
        if self.fmus:
            yield Table("FMUs", ("FMU", "SHA-256"), [(fmu.name, fmu.sha256) for fmu in self.fmus])
        if self.versions:
            yield Table("Versions", ("package", "version"), list(self.versions.items()))


def _show_section(number: int, section: Section) -> dict[str, object]:
    return {
        "id": f"section-{number}",
        "title": section.title,
        "text": section.text,
        "link": section.link,
        "tables": [Markup(table.to_html()) for table in section.tables],
        "pictures": [_embed(picture) for picture in section.pictures],
    }


def _embed(picture: Picture) -> dict[str, str]:
    data = base64.b64encode(picture.path.read_bytes()).decode()
    return {"source": f"data:image/png;base64,{data}", "caption": picture.caption}
