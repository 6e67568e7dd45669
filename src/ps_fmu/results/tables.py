"""Tables of texts, and how they look on a terminal, in Markdown and in HTML."""

from __future__ import annotations

import math
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from html import escape

GAP = 2  # characters between columns
LONGEST_CELLS = range(60, 16, -4)  # characters, tried in turn; a longer cell is broken into lines
NUMBER_WIDTH = 24  # characters; a column with longer texts is left-aligned in HTML and may break lines
MOST_SIDE_BY_SIDE = 5  # columns; of more, long texts in one of them leave no room on a narrow screen
WORDS = ' class="words"'


@dataclass(frozen=True)
class Table:
    """A table of texts; the first column names the rows.

    Raises ``ValueError`` for a row with more or fewer cells than the header.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]

    def __post_init__(self) -> None:
        if any(len(row) != len(self.header) for row in self.rows):
            raise ValueError(f"table {self.caption!r}: every row must have {len(self.header)} entries")

    def to_text(self) -> str:
        """Header and rows in aligned columns, one line each, without the caption."""
        widths = [max(map(len, column)) for column in zip(self.header, *self.rows, strict=True)]
        return self._align(widths)

    def fit_text(self, width: int) -> str | None:
        """As :meth:`to_text` in ``width`` characters: long cells and headings take several lines.

        None if the table is too wide even so.
        """
        columns = list(zip(*self.rows, strict=True)) or [()] * len(self.header)
        for longest in LONGEST_CELLS:
            widths = [
                max([min(len(cell), longest) for cell in cells] + [len(word) for word in title.split()])
                for title, cells in zip(self.header, columns, strict=True)
            ]
            if sum(widths) + GAP * (len(widths) - 1) <= width:
                return self._align(widths)
        return None

    def to_markdown(self) -> str:
        """The caption in bold, then the table."""
        lines = [self.header, ["---"] * len(self.header), *self.rows]
        rows = ("| " + " | ".join(cell.replace("|", "\\|") for cell in line) + " |" for line in lines)
        return f"**{self.caption}**\n\n" + "\n".join(rows)

    def to_html(self) -> str:
        """The table with its caption; all text is escaped.

        Where one of many columns has long texts, each cell names its column: on narrow screens a row is a list.
        """
        wordy = [any(len(cell) > NUMBER_WIDTH for cell in column) for column in zip(*self.rows, strict=True)]
        wordy = wordy or [False] * len(self.header)
        wide = len(self.header) > MOST_SIDE_BY_SIDE and any(wordy[1:])
        names = self.header if wide else None
        rows = "\n".join(f"<tr>{_join_cells('td', row, wordy, names)}</tr>" for row in self.rows)
        caption = f"<caption>{escape(self.caption)}</caption>" if self.caption else ""
        return (
            f'<div class="table{" wide" if wide else ""}"><table>{caption}\n'
            f"<thead><tr>{_join_cells('th', self.header, wordy)}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>"
        )

    def _align(self, widths: Sequence[int]) -> str:
        rule = "-" * (sum(widths) + GAP * (len(widths) - 1))
        rows = [line for row in self.rows for line in _break_row(row, widths)]
        return "\n".join([*_break_row(self.header, widths), rule, *rows])


def format_number(value: float, form: str) -> str:
    """A number as text; a dash for NaN, as for the rejection of what did not move."""
    return "-" if math.isnan(value) else f"{value:{form}}"


def format_angles(orientation_deg: Sequence[float]) -> str:
    """Roll, pitch and yaw (deg) as text."""
    return "({:g}, {:g}, {:g})".format(*orientation_deg)


def _break_row(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row as lines: the first column left-aligned, the others right-aligned."""
    cells = [textwrap.wrap(cell, max(width, 1)) or [""] for cell, width in zip(row, widths, strict=True)]
    height = max(map(len, cells))
    padded = [cell + [""] * (height - len(cell)) for cell in cells]
    return [
        (" " * GAP).join(text.rjust(widths[i]) if i else text.ljust(widths[i]) for i, text in enumerate(line)).rstrip()
        for line in zip(*padded, strict=True)
    ]


def _join_cells(tag: str, texts: Sequence[str], wordy: Iterable[bool], names: Sequence[str] | None = None) -> str:
    labels = [""] * len(texts) if names is None else [f' data-column="{escape(name)}"' for name in names]
    return "".join(
        f"<{tag}{WORDS if words else ''}{label}>{escape(text)}</{tag}>"
        for text, words, label in zip(texts, wordy, labels, strict=True)
    )


def format_tables(tables: Iterable[Table], text: Iterable[str] = ()) -> str:
    """Tables under their captions, then lines of text: what the terminal shows."""
    return "\n".join([*(f"{table.caption}\n{table.to_text()}\n" for table in tables), *text])
