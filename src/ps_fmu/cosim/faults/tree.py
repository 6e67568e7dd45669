"""A file of faults as a tree of values, each with its line: JSON, or YAML where PyYAML is installed."""

from __future__ import annotations

import json
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import SystemFileError
from ..xmlfile import read_bytes

MAXIMUM_BYTES = 4 * 2**20
MOST_VALUES = 200_000
"""Values in a file, those that YAML repeats by an alias counted each time."""
DEEPEST = 16
"""Lists and objects within one another.  A file of faults needs three."""
_SPACE = re.compile(r"[ \t\r\n]*")
_NUMBER = re.compile(r"-?(?:0|[1-9]\d*)(?:\.\d+)?(?:[eE][-+]?\d+)?")
_TEXT = re.compile(r'"(?:[^"\\\x00-\x1f]|\\.)*"')
_WORDS = {"true": True, "false": False, "null": None}
_LONGEST_NUMBER = 400


@dataclass(frozen=True)
class Node:
    """A value and the line where it begins; objects hold nodes by key, lists hold nodes."""

    value: dict[str, Node] | list[Node] | str | int | float | bool | None
    line: int


def read_tree(path: Path) -> Node:
    """The content of a JSON file (``.json``, or one that begins with ``{``), else of a YAML file.

    Raises :class:`SystemFileError` with the line: not such a file, a key that occurs twice, too large, too deep.
    """
    try:
        text = read_bytes(path, MAXIMUM_BYTES).decode("utf-8-sig")
    except UnicodeError as error:
        raise SystemFileError(path, f"is not in UTF-8: {error}") from error
    if path.suffix.lower() == ".json" or text.lstrip()[:1] == "{":
        return _JsonReader(path, text).read()
    return _read_yaml(path, text)


class _JsonReader:
    """RFC 8259.  The parser of the standard library keeps no positions."""

    def __init__(self, path: Path, text: str) -> None:
        self._path, self._text, self._place = path, text, 0
        self._line, self._counted = 1, 0

    def read(self) -> Node:
        node = self._read_value(0)
        if self._next():
            raise self._error(f"expected the end of the file, got {self._text[self._place]!r}")
        return node

    def _error(self, text: str) -> SystemFileError:
        return SystemFileError(self._path, f"is not a JSON file: {text}", self._find_line())

    def _find_line(self) -> int:
        self._line += self._text.count("\n", self._counted, self._place)
        self._counted = self._place
        return self._line

    def _next(self) -> str:
        """The next character that is no space; "" at the end."""
        found = _SPACE.match(self._text, self._place)
        assert found is not None
        self._place = found.end()
        return self._text[self._place : self._place + 1]

    def _read_value(self, depth: int) -> Node:
        first, line = self._next(), self._find_line()
        if depth > DEEPEST:
            raise self._error(f"more than {DEEPEST} lists and objects lie within one another")
        if first == "{":
            return Node(self._read_object(depth), line)
        if first == "[":
            return Node(self._read_list(depth), line)
        if first == '"':
            return Node(self._read_text(), line)
        for word, value in _WORDS.items():
            if self._text.startswith(word, self._place):
                self._place += len(word)
                return Node(value, line)
        found = _NUMBER.match(self._text, self._place)
        if found is None or not found.group():
            raise self._error(f"expected a value, got {first!r}" if first else "the file ends where a value should be")
        if len(found.group()) > _LONGEST_NUMBER:
            raise self._error(f"a number has {len(found.group())} digits")
        self._place = found.end()
        text = found.group()
        return Node(int(text) if text.lstrip("-").isdigit() else float(text), line)

    def _read_text(self) -> str:
        found = _TEXT.match(self._text, self._place)
        if found is None:
            raise self._error("a text does not end in its line, or has control characters")
        try:
            text = str(json.loads(found.group()))
        except json.JSONDecodeError as error:
            raise self._error(error.msg) from error
        self._place = found.end()
        return text

    def _read_object(self, depth: int) -> dict[str, Node]:
        found: dict[str, Node] = {}
        self._place += 1
        more = self._next() != "}"
        while more:
            if self._next() != '"':
                raise self._error("expected a key in quotes")
            key = self._read_text()
            if key in found:
                raise self._error(f"the key {key!r} occurs twice")
            if self._next() != ":":
                raise self._error(f"expected a colon behind the key {key!r}")
            self._place += 1
            found[key] = self._read_value(depth + 1)
            more = self._goes_on("}")
        self._place += 1
        return found

    def _read_list(self, depth: int) -> list[Node]:
        found: list[Node] = []
        self._place += 1
        more = self._next() != "]"
        while more:
            found.append(self._read_value(depth + 1))
            more = self._goes_on("]")
        self._place += 1
        return found

    def _goes_on(self, end: str) -> bool:
        """Whether there is a comma, and not the end of an object or a list."""
        found = self._next()
        if found == ",":
            self._place += 1
        elif found != end:
            raise self._error(f"expected a comma or {end!r}, got {found!r}" if found else f"there is no {end!r}")
        return found == ","


def _read_yaml(path: Path, text: str) -> Node:
    try:
        import yaml
    except ImportError:
        raise SystemFileError(path, "YAML needs PyYAML (pip install 'ps-fmu[yaml]'); JSON needs nothing") from None
    loader = yaml.SafeLoader(text)
    try:
        root = loader.get_single_node()
        if root is None:
            raise SystemFileError(path, "the file is empty", 1)
        return _YamlReader(path, loader).convert(root, 0)
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        reason = getattr(error, "problem", None) or str(error)
        raise SystemFileError(path, f"is not a YAML file: {reason}", None if mark is None else mark.line + 1) from error
    except (RecursionError, ValueError) as error:
        if isinstance(error, SystemFileError):
            raise
        raise SystemFileError(path, f"is not a YAML file that can be used: {error}") from error
    finally:
        loader.dispose()


class _YamlReader:
    """PyYAML's nodes, which know their lines, as ours."""

    def __init__(self, path: Path, loader: Any) -> None:
        self._path, self._loader, self._count = path, loader, 0

    def convert(self, node: Any, depth: int) -> Node:
        line = node.start_mark.line + 1
        self._count += 1
        if depth > DEEPEST or self._count > MOST_VALUES:
            what = f"lists and objects lie more than {DEEPEST} deep" if depth > DEEPEST else "there are too many values"
            raise SystemFileError(self._path, what, line)
        if node.id == "sequence":
            return Node([self.convert(item, depth + 1) for item in node.value], line)
        if node.id == "mapping":
            found: dict[str, Node] = {}
            for key, value in node.value:
                if key.id != "scalar" or key.value in found:
                    raise SystemFileError(self._path, f"the key {key.value!r} occurs twice, or is no text", line)
                found[key.value] = self.convert(value, depth + 1)
            return Node(found, line)
        value = self._loader.construct_object(node)
        if isinstance(value, str) and node.style is None and _NUMBER.fullmatch(value):
            value = float(value)  # 1e-3, which YAML 1.1 takes for a text
        if value is not None and not isinstance(value, bool | int | float | str):
            value = node.value  # a date, which is a text to everybody else
        return Node(value, line)
