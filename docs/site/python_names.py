"""References to Python names: links to the objects that api.toml lists, code for all others.

A docstring says ``:class:`Master``` of what its module imports, or ``:mod:`.rows``` of a neighbour.  Only the objects
of the API have pages; their last names are unique.
"""

from __future__ import annotations

import re
from pkgutil import resolve_name
from typing import Any

from api_pages import list_objects
from docutils import nodes
from sphinx.application import Sphinx

_SHOWN = {name.rpartition(".")[2]: name for name in list_objects().values()}
_ROLE = re.compile(r":(class|func|meth|attr|data|mod|exc|obj):`(~?)(\.*[A-Za-z_][\w.]*)`")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register both steps; called by Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    app.connect("missing-reference", _find_missing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _process(_app: Sphinx, _what: str, _name: str, _found: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = [_ROLE.sub(_write_role, line) for line in lines]


def _write_role(match: re.Match[str]) -> str:
    role, short, target = match.groups()
    shown = target.rpartition(".")[2] if short else target.lstrip(".")
    full = find_object(target)
    return f":{role}:`{shown} <{full}>`" if full else f"``{shown}``"


def find_object(target: str) -> str | None:
    """Full name of an object of the API, or of a member of one, by what a docstring calls it."""
    owner, _, member = target.rpartition(".")
    for name, more in ((member, ""), (owner.rpartition(".")[2], f".{member}")):
        if name in _SHOWN:
            return _SHOWN[name] + more
    return None


def _find_missing(app: Sphinx, env: Any, node: Any, shown: nodes.Element) -> nodes.Element | None:
    """A link from a type in a signature; text for other types, and for a module of ps_fmu that exists."""
    if node.get("refdomain") != "py":
        return None
    target = node["reftarget"]
    if full := find_object(target):
        found = env.domains["py"].resolve_xref(env, node["refdoc"], app.builder, "obj", full, node, shown)
        return shown if found is None else found
    if target.startswith("ps_fmu."):
        try:
            resolve_name(target)
        except (AttributeError, ImportError):
            return None
    return shown
