"""The documentation inside an FMU: the README of its folder as a page that any browser shows."""

from __future__ import annotations

import html
import re
from collections.abc import Iterator
from itertools import groupby

_STYLE = (
    "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.2em .6em;text-align:left}"
    "pre{background:#f4f4f4;padding:.8em;overflow:auto}"
)
_ITEM = re.compile(r"\s*([-*]|\d+\.)\s+(.*)")
_HEADING = re.compile(r"(#{1,6})\s+(.*)")


def page(markdown: str, title: str) -> bytes:
    """A complete HTML page from the Markdown that our READMEs use.

    Headings, paragraphs, flat lists, tables, fenced code; inline code, emphasis and links.  All else stays
    text.
    """
    body = "\n".join(_blocks(markdown))
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{html.escape(title)}</title>\n"
        f"<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    ).encode()


def _blocks(markdown: str) -> Iterator[str]:
    for i, part in enumerate(re.split(r"^```.*\n?", markdown, flags=re.MULTILINE)):
        if i % 2:  # between two fences
            yield f"<pre>{html.escape(part)}</pre>"
            continue
        for kind, lines in groupby(part.splitlines(), _kind):
            if kind == "heading":
                yield from map(_heading, lines)
            elif kind == "table":
                yield _table(list(lines))
            elif kind == "text":
                yield from _paragraph_and_list(list(lines))


def _kind(line: str) -> str:
    if not line.strip():
        return "blank"
    if line.startswith("|"):
        return "table"
    return "heading" if _HEADING.match(line) else "text"


def _heading(line: str) -> str:
    marks, text = line.split(maxsplit=1)
    return f"<h{len(marks)}>{_inline(text)}</h{len(marks)}>"


def _table(lines: list[str]) -> str:
    rows = [[cell.strip() for cell in line.strip().strip("|").split("|")] for line in lines]
    rows = [row for row in rows if not all(re.fullmatch(":?-+:?", cell) for cell in row)]
    tags = ["th"] + ["td"] * (len(rows) - 1)
    return "<table>\n{}\n</table>".format(
        "\n".join(
            "<tr>" + "".join(f"<{tag}>{_inline(cell)}</{tag}>" for cell in row) + "</tr>"
            for tag, row in zip(tags, rows, strict=True)
        )
    )


def _paragraph_and_list(lines: list[str]) -> Iterator[str]:
    """Text up to the first list marker is a paragraph; from there on each marker begins an item."""
    pieces: list[list[str]] = [[]]
    for line in lines:
        item = _ITEM.match(line)
        if item:
            pieces.append([item[2]])
        else:
            pieces[-1].append(line.strip())
    paragraph, *items = (" ".join(piece) for piece in pieces)
    if paragraph:
        yield f"<p>{_inline(paragraph)}</p>"
    if items:
        tag = "ol" if re.match(r"\s*\d", next(filter(_ITEM.match, lines))) else "ul"
        yield f"<{tag}>\n" + "\n".join(f"<li>{_inline(item)}</li>" for item in items) + f"\n</{tag}>"


def _inline(text: str) -> str:
    """Code first, so that nothing in it is taken for markup."""
    pieces = re.split(r"`([^`]*)`", text)
    return "".join(f"<code>{html.escape(p)}</code>" if i % 2 else _emphasis(p) for i, p in enumerate(pieces))


def _emphasis(text: str) -> str:
    text = html.escape(text, quote=False)
    text = re.sub(r"\*\*(.+?)\*\*", r"<strong>\1</strong>", text)
    text = re.sub(r"(?<![\w*])\*([^\s*][^*]*)\*(?![\w*])", r"<em>\1</em>", text)
    return re.sub(r"\[([^\]]+)\]\((https?://[^)\s]+)\)", r'<a href="\2">\1</a>', text)
