"""Puts a page together: the template with its texts escaped, the scripts, the style and the data in one file."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.resources import files
from importlib.resources.abc import Traversable
from typing import Any

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

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


# --- How data go into the page: in the form that its scripts read -----------------------------------------------------

Array = NDArray[np.float64]
Entry = dict[str, object]


def encode(values: Array) -> str:
    """Base64 of the values as little-endian float32, row by row."""
    return base64.b64encode(np.ascontiguousarray(values, dtype="<f4").tobytes()).decode("ascii")


def encode_levels(levels: Array, lowest: float) -> str:
    """Base64 of values from ``lowest`` to 0 as bytes from 0 to 255, row by row."""
    steps = np.rint(255.0 * (1.0 - np.clip(levels / lowest, 0.0, 1.0)))
    return base64.b64encode(steps.astype(np.uint8).tobytes()).decode("ascii")


def pack_fields(shown: Any) -> Entry:
    """The fields of a dataclass, named as in JavaScript; a field that has a ``pack`` of its own is packed by that."""
    return {_rename(field.name): _pack(getattr(shown, field.name)) for field in fields(shown)}


def _pack(value: Any) -> object:
    if hasattr(value, "pack"):
        return value.pack()
    if is_dataclass(value):
        return pack_fields(value)
    if isinstance(value, np.ndarray):
        return encode(value)
    if isinstance(value, Sequence) and not isinstance(value, str):
        return [_pack(each) for each in value]
    return value


def _rename(name: str) -> str:
    first, *others = name.split("_")
    return first + "".join(map(str.capitalize, others))
