"""report.html: one file with the results, figures and origin of a run, to be read and passed on as it is.

Pictures are embedded, nothing is fetched from elsewhere, and every text is escaped.
"""

from __future__ import annotations

import base64
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from html import escape
from pathlib import Path

from ..slavekit.pack.files import write_atomically
from .summary import FmuFile
from .tables import Table


@dataclass(frozen=True)
class Picture:
    """A PNG file with the caption that explains it."""

    path: Path
    caption: str


def draw_pictures(
    folder: Path, prefix: str, figures: Iterable[tuple[str, str, Callable[[Path], None]]]
) -> list[Picture]:
    """Draw figures (name, caption, function that draws it to a file) to ``PREFIX_NAME.png`` in a folder.

    Raises OSError.
    """
    pictures = []
    for name, caption, paint in figures:
        path = folder / f"{prefix}_{name}.png"
        paint(path)
        pictures.append(Picture(path, caption))
    return pictures


@dataclass(frozen=True)
class Report:
    """What a report shows, in this order."""

    title: str
    verdicts: Table | None = None  # on the requirements
    text: Sequence[str] = ()  # paragraphs: what was run, and how to read it
    tables: Sequence[Table] = ()
    pictures: Sequence[Picture] = ()
    parameters: Mapping[str, object] = field(default_factory=dict)  # options and changed parameters
    fmus: Sequence[FmuFile] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    warnings: Sequence[str] = ()  # unconnected inputs, statuses, saturation

    def html(self) -> str:
        """The page.  Raises ``OSError`` if a picture cannot be read."""
        written = datetime.now(UTC).isoformat(sep=" ", timespec="seconds")
        parts = [f"<h1>{escape(self.title)}</h1>"]
        parts += [self.verdicts.to_html()] if self.verdicts is not None else []
        parts += [f"<p>{escape(paragraph)}</p>" for paragraph in self.text]
        if self.warnings:
            items = "".join(f"<li>{escape(warning)}</li>" for warning in self.warnings)
            parts.append(f'<section class="warnings"><h2>Warnings</h2><ul>{items}</ul></section>')
        parts += [table.to_html() for table in self.tables]
        parts += [_format_picture(picture) for picture in self.pictures]
        if self.parameters:
            rows = [(name, str(value)) for name, value in self.parameters.items()]
            parts.append(Table("Parameters of this run", ("parameter", "value"), rows).to_html())
        if self.fmus:
            rows = [(fmu.name, fmu.sha256) for fmu in self.fmus]
            parts.append(Table("FMUs", ("FMU", "SHA-256"), rows).to_html())
        if self.versions:
            parts.append(Table("Versions", ("package", "version"), list(self.versions.items())).to_html())
        parts.append(f"<footer>Written {written}</footer>")
        return _PAGE.format(title=escape(self.title), style=_STYLE, body="\n".join(parts))

    def write(self, path: Path) -> None:
        """Write the page in one go; raises ``OSError`` and leaves what was there if that fails."""
        write_atomically(path, self.html())


def _format_picture(picture: Picture) -> str:
    data = base64.b64encode(picture.path.read_bytes()).decode()
    caption = escape(picture.caption)
    image = f'<img src="data:image/png;base64,{data}" alt="{caption}">'
    return f"<figure>{image}<figcaption>{caption}</figcaption></figure>"


_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color:
#222; } h1 { font-size: 1.6rem; } h2 { font-size: 1.1rem; margin: 0; } .table { overflow-x: auto; margin:
1.5rem 0; } table { border-collapse: collapse; border-top: 2px solid #222; border-bottom: 2px solid #222;
} caption { text-align: left; font-weight: 600; padding: 0.3rem 0; } th, td { padding: 0.25rem 0.9rem;
text-align: right; white-space: nowrap; font-variant-numeric: tabular-nums; } th { border-bottom: 1px
solid #222; vertical-align: bottom; } td { vertical-align: top; } th:first-child, td:first-child, .words
{ text-align: left; } th, .words { white-space: normal; } .words { min-width: 11rem; } figure { margin: 2rem 0; } img {
max-width: 100%; height: auto; } figcaption, footer { color: #555; font-size: 0.9rem; } .warnings {
border-left: 4px solid #d55e00; padding: 0.5rem 1rem; background: #fdf3ec; }
"""

_PAGE = """<!DOCTYPE html>
<html lang="en"> <head> <meta charset="utf-8"> <meta name="viewport" content="width=device-width,
initial-scale=1"> <meta http-equiv="Content-Security-Policy" content="default-src 'none'; img-src data:;
style-src 'unsafe-inline'"> <title>{title}</title> <style>{style}</style> </head> <body> {body} </body>
</html>
"""
