"""Puts a page together: the template with its texts escaped, the scripts, the style and the data in one file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable

from markupsafe import Markup

SCRIPTS = (
    "data.js", "text.js", "theme.js", "linked.js", "gestures.js", "chart.js",
    "cloud.js", "waterfall.js", "scatter.js", "cases.js", "space.js", "mechanism.js", "player.js", "main.js",
)  # fmt: skip
"""The page's own scripts, in this order."""


def render_page(shown: Mapping[str, object], explored: Mapping[str, object]) -> str:
    """The page.

    Parameters
    ----------
    shown: what the template names; texts are escaped.
    explored: what the scripts read, numbers, texts and lists; empty: the page gets no script.
    """
    from jinja2 import Environment, StrictUndefined  # when a page is written: 0.1 s at the start of each command
    from jinja2.utils import htmlsafe_json_dumps

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    template = environment.from_string((_folder() / "template.html.j2").read_text(encoding="utf-8"))
    scripts = [_read("vendor/uPlot.iife.min.js"), _join_scripts()] if explored else []
    style = _read("page.css") + (_read("vendor/uPlot.min.css") if explored else "")
    return template.render(
        **shown,
        explored=explored,
        data=htmlsafe_json_dumps(explored) if explored else "",  # no <, > or & is left in it
        # Files of the package, not data: marked as safe here and nowhere else.
        scripts=[Markup(script) for script in scripts],
        style=Markup(style),
        policy=_make_policy(scripts),
    )


def _make_policy(scripts: list[str]) -> str:
    """Content security policy: these scripts and no others, nothing from elsewhere."""
    hashes = [base64.b64encode(hashlib.sha256(script.encode()).digest()).decode() for script in scripts]
    sources = " ".join(f"'sha256-{value}'" for value in hashes)
    allowed = f"; script-src {sources}" if hashes else ""
    return f"default-src 'none'; img-src data:; style-src 'unsafe-inline'{allowed}"


def _join_scripts() -> str:
    """The page's scripts as one, with no names left in the window."""
    body = "\n".join(_read(name) for name in SCRIPTS)
    return f'(() => {{\n"use strict";\n{body}\n}})();'


@cache
def _read(name: str) -> str:
    return _folder().joinpath(*name.split("/")).read_text(encoding="utf-8").strip()


def _folder() -> Traversable:
    return files(__package__)
