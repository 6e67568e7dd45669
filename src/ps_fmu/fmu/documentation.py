"""The documentation inside an FMU: the README of its folder as a page that any browser shows."""

from __future__ import annotations

import html

_STYLE = (
    "body{font:16px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em}"
    "table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.2em .6em;text-align:left}"
    "pre{background:#f4f4f4;padding:.8em;overflow:auto}"
)


def page(text: str, title: str) -> bytes:
    """A complete HTML page from a README in Markdown with tables and fenced code."""
    from markdown import markdown  # only who builds FMUs needs it

    body = markdown(text, extensions=["tables", "fenced_code", "sane_lists"], output_format="html")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f"<title>{html.escape(title)}</title>\n"
        f"<style>{_STYLE}</style>\n</head>\n<body>\n{body}\n</body>\n</html>\n"
    ).encode()
