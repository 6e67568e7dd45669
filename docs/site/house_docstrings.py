"""Docstrings as this project writes them, made into what Sphinx reads.

Lists of parameters stand under an underlined word, an entry on a line of its own with its text behind a colon::

    Parameters
    ----------
    frequency: (n,), Hz, ascending.
    psd, step: unit^2/Hz, and so on,
        which may go on in indented lines.

They become definition lists.  Signatures have types as the source has them.  A comment behind a field of a dataclass,
``mass: float  # kg``, becomes its text.  A bar, as in |x|, is a bar.
"""

from __future__ import annotations

import ast
import inspect
import re
import sys
from collections.abc import Iterator
from functools import cache
from types import ModuleType
from typing import Any

from sphinx.application import Sphinx
from sphinx.util.inspect import stringify_signature

_WORDS = {"Parameters", "Attributes", "Returns", "Raises"}
_ENTRY = re.compile(r"^(\*{0,2}[A-Za-z_][\w.]*(?:, \*{0,2}[A-Za-z_][\w.]*)*): (.*)$")
_FIELD = re.compile(r"^ {4}(\w+): [^#]*#:? *((?!fmt:|noqa|type:)\S.*)$")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the conversion; called by Sphinx."""
    app.connect("autodoc-process-docstring", _process)
    app.connect("autodoc-process-signature", _process_signature)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _process_signature(
    _app: Sphinx, what: str, _name: str, found: Any, _options: Any, arguments: str | None, result: str | None
) -> tuple[str | None, str | None]:
    """Arguments and result with the types as the source has them, such as ``ArrayLike``."""
    if not arguments or what not in ("class", "function", "method"):
        return arguments, result
    signature = inspect.signature(found)
    if what == "method":
        signature = signature.replace(parameters=list(signature.parameters.values())[1:])
    text = stringify_signature(signature, show_return_annotation=False)
    given = signature.return_annotation
    return text, given if what != "class" and isinstance(given, str) else result


def _process(_app: Sphinx, what: str, _name: str, found: Any, _options: Any, lines: list[str]) -> None:
    lines[:] = escape_bars(convert(lines))
    if what == "class" and inspect.isclass(found):
        lines += describe_fields(found)


def escape_bars(lines: list[str]) -> list[str]:
    """The lines with bars escaped, where they are not in code: reStructuredText has a use of its own for them."""
    made, block = [], None  # indentation of the paragraph that a literal block belongs to
    for line in lines:
        indent = len(line) - len(line.lstrip())
        if block is not None and line.strip() and indent <= block:
            block = None
        if block is None:
            parts = re.split("(``.*?``)", line)
            line = "".join(part if part.startswith("``") else part.replace("|", "\\|") for part in parts)
            block = indent if line.rstrip().endswith("::") else None
        made.append(line)
    return made


def convert(lines: list[str]) -> list[str]:
    """The lines of a docstring with its lists of parameters made into definition lists."""
    made: list[str] = []
    rest = list(lines)
    while rest:
        line = rest.pop(0)
        if line in _WORDS and rest and re.fullmatch("-{3,}", rest[0]):
            rest.pop(0)
            made += [f".. rubric:: {line}", "", *_convert_list(rest), ""]
        else:
            made.append(line)
    return made


def _convert_list(rest: list[str]) -> list[str]:
    """Take the entries of a list from the front of ``rest``, up to a blank line; the list."""
    made: list[str] = []
    while rest and rest[0]:
        line = rest.pop(0)
        if entry := _ENTRY.match(line):
            terms = ", ".join(f"``{term}``" for term in entry[1].split(", "))
            made += [terms, f"    {entry[2]}"]
        else:  # goes on, indented or not
            made.append(f"    {line.strip()}" if made else line)
    return made


@cache
def _list_classes(module: ModuleType) -> dict[str, list[str]]:
    """The lines of each class of a module, by its qualified name; none if there is no source."""
    try:
        source = inspect.getsource(module)
    except (OSError, TypeError):
        return {}
    lines = source.splitlines()
    return {name: lines[node.lineno - 1 : node.end_lineno] for name, node in _walk_classes(ast.parse(source), "")}


def _walk_classes(tree: ast.AST, prefix: str) -> Iterator[tuple[str, ast.ClassDef]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ClassDef):
            yield prefix + node.name, node
            yield from _walk_classes(node, f"{prefix}{node.name}.")


def describe_fields(found: type) -> list[str]:
    """A list of the fields of a class that have a comment in their line, with it."""
    source = _list_classes(sys.modules[found.__module__]).get(found.__qualname__, [])
    fields = [match for line in source if (match := _FIELD.match(line))]
    if not fields:
        return []
    made = ["", ".. rubric:: Fields", ""]
    for field in fields:
        text = field[2].replace("\\", "\\\\").replace("*", "\\*").replace("|", "\\|")
        made += [f"``{field[1]}``", f"    {text}"]
    return [*made, ""]
