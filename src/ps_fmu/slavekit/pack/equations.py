"""Equations of a README: LaTeX, written as GitHub shows it, becomes MathML, which browsers draw by themselves.

In a line ``$x^2$``; on its own a fenced block of the language ``math``.
"""

from __future__ import annotations

import re
from typing import Any
from xml.etree.ElementTree import ParseError, fromstring

from latex2mathml.converter import convert
from markdown import Markdown
from markdown.extensions import Extension
from markdown.inlinepatterns import InlineProcessor
from markdown.preprocessors import Preprocessor

_BLOCK = re.compile(r"^```math\n(.*?)\n```$", re.MULTILINE | re.DOTALL)
_INLINE = r"(?<![\\$\w])\$(?!\s)([^$\n]+?)(?<![\s\\])\$(?![$\w])"

# Python-Markdown's own: fenced code has 25 among the preprocessors; backticks 190 and escapes 180 among the patterns.
_BEFORE_FENCED_CODE = 30
_BETWEEN_CODE_AND_ESCAPES = 185


def convert_to_mathml(latex: str, display: str) -> str:
    """The element ``math``; ``display`` is ``"block"`` or ``"inline"``.

    Raises ValueError if the converter does not know a part of it: it lets that pass as text.
    """
    text: str = convert(latex, display=display)
    try:
        known = "\\" not in "".join(fromstring(text).itertext())
    except ParseError:
        known = False
    if not known:
        raise ValueError(f"latex2mathml cannot convert this equation: {latex.strip()}")
    return text


class Equations(Extension):
    """Extension of Python-Markdown."""

    def extendMarkdown(self, md: Markdown) -> None:
        """Register both forms."""
        md.preprocessors.register(_Blocks(md), "equations", _BEFORE_FENCED_CODE)
        md.inlinePatterns.register(_Inline(_INLINE, md), "equation", _BETWEEN_CODE_AND_ESCAPES)


class _Blocks(Preprocessor):
    def run(self, lines: list[str]) -> list[str]:
        def stored(match: re.Match[str]) -> str:
            place: str = self.md.htmlStash.store(convert_to_mathml(match[1], "block"))
            return f"\n\n{place}\n\n"

        return _BLOCK.sub(stored, "\n".join(lines)).split("\n")


class _Inline(InlineProcessor):
    def handleMatch(self, m: re.Match[str], data: str) -> Any:
        place = self.md.htmlStash.store(convert_to_mathml(m[1], "inline"))
        return place, m.start(0), m.end(0)
