"""Equations as MathML, which browsers draw by themselves: the pages need no script and no network for them.

A renderer for Sphinx's ``html_math_renderer``.  It shares the conversion with the documentation within the FMUs, so
that an equation of a README is shown by both, or refused by both.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.errors import SphinxError

from ps_fmu.slavekit.pack.page import convert_to_mathml

# Brackets stretch only where the reader has a font for mathematics; site.css draws those of matrices.
_BRACKETED = re.compile("<mo>&#x0005B;</mo><mtable>(.*?)</mtable><mo>&#x0005D;</mo>")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the renderer; called by Sphinx."""
    app.add_html_math_renderer("mathml", (_visit_inline, None), (_visit_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _visit_inline(translator: Any, node: nodes.math) -> None:
    translator.body.append(_convert(node, "inline"))
    raise nodes.SkipNode


def _visit_block(translator: Any, node: nodes.math_block) -> None:
    translator.body.append(f'<div class="equation">{_convert(node, "block")}</div>\n')
    raise nodes.SkipNode


def _convert(node: nodes.Element, display: str) -> str:
    try:
        return _BRACKETED.sub(r'<mtable class="bracketed">\1</mtable>', convert_to_mathml(node.astext(), display))
    except ValueError as error:
        raise SphinxError(f"{node.source}: {error}") from error
