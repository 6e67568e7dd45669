"""References to Python names, resolved as Python resolves them: in the module where the docstring stands.

A docstring says ``:class:`Master``` of what its module imports, or ``:mod:`.rows``` of a neighbour.  Sphinx would look
for these in the module that it describes, or anywhere.  A name that exists without a page (of a private base, of
another package) becomes plain text.  One that does not exist stays as it is, and Sphinx warns.
"""

from __future__ import annotations

import ast
import builtins
import importlib
import inspect
import re
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import Any

from api_pages import list_objects
from docutils import nodes
from sphinx.application import Sphinx

_SHOWN = list_objects()
_ROLE = re.compile(r":(class|func|meth|attr|data|mod|exc|obj):`(~?)(\.*[A-Za-z_][\w.]*)`")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register both steps; called by Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    app.connect("missing-reference", _find_missing)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _process(_app: Sphinx, _what: str, name: str, found: Any, _options: Any, lines: list[str]) -> None:
    module, own = getattr(found, "__module__", None), getattr(found, "__qualname__", "")
    scope = (
        f"{module}.{own}" if module else name
    )  # where it is defined, which may be another module than it is offered by
    lines[:] = [_ROLE.sub(lambda match: _resolve_role(match, scope), line) for line in lines]


def _resolve_role(match: re.Match[str], scope: str) -> str:
    role, short, target = match.groups()
    full = resolve(target, scope)
    if full is None:
        return match[0]
    full = _SHOWN.get(full, full)
    shown = target.rpartition(".")[2] if short else target.lstrip(".")
    return f":{role}:`{shown} <{full}>`"


def _find_missing(app: Sphinx, env: Any, node: Any, shown: nodes.Element) -> nodes.Element | None:
    """A link to the page of a name, or text for a name that exists: in its place, or where an object is defined."""
    if node.get("refdomain") != "py":
        return None
    scope = ".".join(filter(None, (node.get("py:module"), node.get("py:class"))))
    scopes = (scope, *dict.fromkeys(place.rpartition(".")[0] for place in _SHOWN))
    full = next(filter(None, (resolve(node["reftarget"], place) for place in scopes)), None)
    if full not in _SHOWN:
        return shown if full else None
    found: nodes.Element | None = env.domains["py"].resolve_xref(
        env, node["refdoc"], app.builder, "obj", _SHOWN[full], node, shown
    )
    return found


def resolve(target: str, scope: str) -> str | None:
    """Full name of what ``target`` means in ``scope``, the full name of a module, class or function; None: nothing."""
    bare = target.lstrip(".")
    for place in (*_list_scopes(scope), ""):
        full = f"{place}.{bare}".lstrip(".")
        if _exists(full):
            return full
        first, dot, rest = bare.partition(".")
        if origin := _list_imports(place).get(first):
            full = f"{origin}{dot}{rest}"
            if _exists(full):
                return full
    return None


def _list_scopes(scope: str) -> Iterator[str]:
    """The scope itself, what it lies in, and so on."""
    while scope:
        yield scope
        scope = scope.rpartition(".")[0]


@cache
def _exists(full: str) -> bool:
    """Whether there is a module, or something in it, of a full name."""
    parts = full.split(".")
    for count in range(len(parts), 0, -1):
        found: Any = _find_module(".".join(parts[:count]))
        if found is None:
            continue
        for part in parts[count:]:
            if part in getattr(found, "__annotations__", {}):  # a field of a dataclass without a default
                return part == parts[-1]
            if not hasattr(found, part):
                return False
            found = getattr(found, part)
        return True
    return hasattr(builtins, full)


@cache
def _find_module(name: str) -> ModuleType | None:
    """A module; None if there is none of this name.  What is in no package is not looked for: that takes longest."""
    package = name.rpartition(".")[0]
    if package and not hasattr(_find_module(package), "__path__"):
        return None
    try:
        return importlib.import_module(name)
    except ImportError:
        return None


@cache
def _list_imports(module: str) -> dict[str, str]:
    """Names that a module imports from others, those for typing included, with their full names there."""
    try:
        source = ast.parse(inspect.getsource(importlib.import_module(module)))
    except (ImportError, OSError, TypeError, ValueError):
        return {}
    package = importlib.import_module(module).__package__ or ""
    found = {}
    for node in ast.walk(source):
        if isinstance(node, ast.ImportFrom):
            base = package.rsplit(".", node.level - 1)[0] if node.level else ""
            origin = ".".join(filter(None, (base, node.module)))
            found |= {alias.asname or alias.name: f"{origin}.{alias.name}" for alias in node.names}
    return found
