"""Tables of texts, and how they look on a terminal, in Markdown and in HTML."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from html import escape
from itertools import product, zip_longest

GAP = 2  # characters between columns
USUAL = 100  # characters of a line on a terminal
LONGEST_CELLS = range(60, 11, -1)  # characters, tried in turn; a longer cell is broken into lines
NUMBER_WIDTH = 24  # characters; a column with longer texts is left-aligned in HTML and may break lines
MOST_SIDE_BY_SIDE = 5  # columns; of more, long texts in one of them leave no room on a narrow screen
INDENT = "    "  # of a note
WORDS = ' class="words"'


@dataclass(frozen=True)
class Table:
    """A table of texts; the first column names the rows.  ``notes``: a text below each row, or none at all.

    Raises ``ValueError`` for a row with more or fewer cells than the header, and for notes that are fewer than rows.
    """

    caption: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    notes: Sequence[str] = ()

    def __post_init__(self) -> None:
        if any(len(row) != len(self.header) for row in self.rows):
            raise ValueError(f"table {self.caption!r}: every row must have {len(self.header)} entries")
        if self.notes and len(self.notes) != len(self.rows):
            raise ValueError(f"table {self.caption!r}: expected {len(self.rows)} notes, got {len(self.notes)}")

    def to_text(self, width: int = USUAL) -> str:
        """Header, rows and notes in aligned columns, without the caption.

        Long cells and headings take several lines, so that no line is longer than ``width`` characters, unless there
        are too many columns for that.
        """
        tried = list(self._try_widths())
        return self._align(next((widths for widths in tried if _add_up(widths) <= width), tried[-1]))

    def fits(self, width: int) -> bool:
        """Whether :meth:`to_text` takes no more than ``width`` characters with all words whole."""
        return any(_add_up(widths) <= width for widths in list(self._try_widths())[: 1 + len(LONGEST_CELLS)])

    def _try_widths(self) -> Iterator[list[int]]:
        """Widths of the columns, the widest first: lines whole; cells broken between words; words broken."""
        columns = list(zip(*self.rows, strict=True)) or [()] * len(self.header)
        yield [max(map(len, column)) for column in zip(self.header, *self.rows, strict=True)]
        parts = [max((len(part) for cell in cells for part in _split(cell)), default=0) for cells in columns]
        for least, longest in product((parts, [0] * len(parts)), LONGEST_CELLS):
            yield [
                max(part, *(min(len(cell), longest) for cell in cells), *(len(word) for word in title.split()), 1)
                for part, title, cells in zip(least, self.header, columns, strict=True)
            ]

    def to_markdown(self) -> str:
        """The caption in bold, then the table."""
        lines: list[Sequence[str]] = [self.header, ["---"] * len(self.header)]
        for row, note in zip_longest(self.rows, self.notes, fillvalue=""):
            lines += [row, *([[note, *[""] * (len(row) - 1)]] if note else [])]
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
        notes = [f'<tr class="note"><td colspan="{len(self.header)}">{escape(note)}</td></tr>' for note in self.notes]
        rows = "\n".join(
            f"<tr>{_join_cells('td', row, wordy, names)}</tr>" + (f"\n{shown}" if note else "")
            for row, note, shown in zip_longest(self.rows, self.notes, notes, fillvalue="")
        )
        caption = f"<caption>{escape(self.caption)}</caption>" if self.caption else ""
        return (
            f'<div class="table{" wide" if wide else ""}"><table>{caption}\n'
            f"<thead><tr>{_join_cells('th', self.header, wordy)}</tr></thead>\n<tbody>\n{rows}\n</tbody></table></div>"
        )

    def _align(self, widths: Sequence[int]) -> str:
        rule = "-" * _add_up(widths)
        lines = [*_break_row(self.header, widths), rule]
        for row, note in zip(self.rows, self.notes or [""] * len(self.rows), strict=True):
            lines += _break_row(row, widths)
            lines += textwrap.wrap(note, max(len(rule), USUAL), initial_indent=INDENT, subsequent_indent=INDENT)
        return "\n".join(lines)


def format_number(value: float, form: str) -> str:
    """A number as text; a dash for NaN, as for the rejection of what did not move."""
    return "-" if math.isnan(value) else f"{value:{form}}"


def format_angles(orientation_deg: Sequence[float]) -> str:
    """Roll, pitch and yaw (deg) as text."""
    return "({:g}, {:g}, {:g})".format(*orientation_deg)


def _break_row(row: Sequence[str], widths: Sequence[int]) -> list[str]:
    """A row as lines: the first column left-aligned, the others right-aligned."""
    cells = [_wrap(cell, max(width, 1)) or [""] for cell, width in zip(row, widths, strict=True)]
    height = max(map(len, cells))
    padded = [cell + [""] * (height - len(cell)) for cell in cells]
    return [
        (" " * GAP).join(text.rjust(widths[i]) if i else text.ljust(widths[i]) for i, text in enumerate(line)).rstrip()
        for line in zip(*padded, strict=True)
    ]


def _add_up(widths: Sequence[int]) -> int:
    """Characters of a line."""
    return sum(widths) + GAP * (len(widths) - 1)


def _split(cell: str) -> list[str]:
    """The words of a cell; a name of a signal, or of a path, ends a word behind each dot."""
    return [part for part in re.split(r" |(?<=[./])(?=[a-z])", cell) if part]


def _wrap(cell: str, width: int) -> list[str]:
    """A cell as lines."""
    lines: list[str] = []
    for word in cell.split():
        for place, part in enumerate(_split(word)):
            joint = " " if place == 0 else ""
            if lines and len(lines[-1] + joint + part) <= width:
                lines[-1] += joint + part
            else:
                lines += textwrap.wrap(part, width)
    return lines


def _join_cells(tag: str, texts: Sequence[str], wordy: Iterable[bool], names: Sequence[str] | None = None) -> str:
    labels = [""] * len(texts) if names is None else [f' data-column="{escape(name)}"' for name in names]
    return "".join(
        f"<{tag}{WORDS if words else ''}{label}>{escape(text)}</{tag}>"
        for text, words, label in zip(texts, wordy, labels, strict=True)
    )


def format_tables(tables: Iterable[Table], text: Iterable[str] = (), width: int = USUAL) -> str:
    """Tables under their captions, then paragraphs of text, in lines of ``width``: what the terminal shows."""
    shown = [f"{wrap_text(table.caption, width)}\n{table.to_text(width)}\n" for table in tables]
    return "\n".join([*shown, *(wrap_text(paragraph, width) for paragraph in text)])


def wrap_text(text: str, width: int = USUAL) -> str:
    """Text in lines of at most ``width`` characters; lines stay apart, paths and commands whole."""
    return "\n".join(
        textwrap.fill(line, width, break_long_words=False, break_on_hyphens=False) for line in text.split("\n")
    )
