"""Files that people write, in TOML, JSON or YAML, as objects of a :class:`msgspec.Struct`.

The fields of the class are the keys: their types, defaults and bounds (:class:`msgspec.Meta`) are the rules of a file.
An error names the file and the key, and suggests a key that is spelt nearly so.
"""

from __future__ import annotations

import json
import re
import reprlib
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from ..files.plain import read_bytes
from .errors import SystemFileError
from .structure import suggest_names

MAXIMUM_BYTES = 4 * 2**20
DEEPEST, MOST_VALUES = 16, 200_000
"""Of a YAML file: lists and objects within one another; values, those that an alias repeats counted each time."""
T = TypeVar("T")
Hook = Callable[[type, Any], Any]
"""Makes a value of a type that msgspec does not know, as a quantity with a unit; raises ValueError with the reason."""
_FORMS = {".json": "JSON", ".yaml": "YAML", ".yml": "YAML"}
_NUMBER = re.compile(r"-?(?:0|[1-9]\d*)(?:\.\d+)?(?:[eE][-+]?\d+)?")
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
_MISSING = re.compile(r"Object missing required field `(.*)`", re.DOTALL)
_TYPES = re.compile(r"`([^`]*)`")
_WORDS = {
    "float": "a number", "int": "a whole number", "str": "a text", "bool": "true or false", "array": "a list",
    "object": "an object with keys",
}  # fmt: skip
_CHOICE = re.compile(r"Invalid enum value (.*)", re.DOTALL)


def read_document(path: Path, kind: type[T], hook: Hook | None = None) -> T:
    """The content of a file, TOML or (``.json``) JSON, as an object of ``kind``.

    Raises :class:`.errors.SystemFileError`: it cannot be read, or a key or value is not as ``kind`` has it.
    """
    return convert_document(load_document(path), kind, path, hook)


def load_document(path: Path, other: str = "TOML") -> Any:
    """The content of a file as dicts, lists and values.  Raises as :func:`read_document`.

    ``other``: form of a file whose name does not end as that of a JSON or YAML file, TOML or YAML; as a YAML file
    one that begins with ``{`` is JSON, too.
    """
    content = read_bytes(path, MAXIMUM_BYTES)
    form = _FORMS.get(path.suffix.lower(), other)
    try:
        text = content.decode("utf-8-sig")  # some editors begin a file with a mark
        if form == "YAML" and text.lstrip().startswith("{"):
            form = "JSON"
        if form == "JSON":
            return json.loads(text, object_pairs_hook=_refuse_repeated, parse_constant=_refuse_constant)
        return tomllib.loads(text) if form == "TOML" else _load_yaml(text)
    except RecursionError:
        raise SystemFileError(path, "its values are nested too deeply") from None
    except ImportError:
        raise SystemFileError(path, "YAML needs PyYAML (pip install 'ps-fmu[yaml]'); JSON needs nothing") from None
    except ValueError as error:
        raise SystemFileError(path, f"is not a {form} file: {error}") from error


def convert_document(data: object, kind: type[T], path: Path, hook: Hook | None = None, place: str = "") -> T:
    """Loaded values as an object of ``kind``.  ``place``: of the values in the file, for errors.  Raises as above."""
    try:
        return msgspec.convert(data, kind, dec_hook=_hook(hook))
    except msgspec.ValidationError as error:
        raise SystemFileError(path, _explain(str(error), data, kind, hook, place)) from error


def _hook(hook: Hook | None) -> Hook:
    def make(kind: type, value: Any) -> Any:
        if hook is None:
            raise TypeError(f"nothing makes a {kind.__name__} of {value!r}")
        return hook(kind, value)

    return make


def _refuse_repeated(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) < len(pairs):
        seen: set[str] = set()
        twice = next(key for key, _ in pairs if key in seen or seen.add(key))  # type: ignore[func-returns-value]
        raise ValueError(f"the key {twice!r} occurs twice in one object")
    return found


def _refuse_constant(name: str) -> None:
    raise ValueError(f"{name} is not a number of JSON")


def _load_yaml(text: str) -> Any:
    import yaml

    loader, count = yaml.SafeLoader(text), 0

    def convert(node: Any, depth: int) -> Any:
        nonlocal count
        count += 1
        if depth > DEEPEST or count > MOST_VALUES:
            raise ValueError(f"more than {DEEPEST} lists and objects within one another, or {MOST_VALUES} values")
        if node.id == "sequence":
            return [convert(item, depth + 1) for item in node.value]
        if node.id == "mapping":
            if any(key.id != "scalar" for key, _ in node.value):
                raise ValueError(f"line {node.start_mark.line + 1}: expected a text as key")
            return _refuse_repeated([(key.value, convert(value, depth + 1)) for key, value in node.value])
        value = loader.construct_object(node)
        if isinstance(value, str) and node.style is None and _NUMBER.fullmatch(value):
            return float(value)  # 1e-3, which YAML 1.1 takes for a text
        return value if value is None or isinstance(value, bool | int | float | str) else node.value  # a date is a text

    try:
        root = loader.get_single_node()
        return None if root is None else convert(root, 0)
    except yaml.YAMLError as error:
        raise ValueError(str(error)) from error
    finally:
        loader.dispose()


def _explain(text: str, data: object, kind: Any, hook: Hook | None, place: str) -> str:
    """What msgspec says, in the words of a file: the key first, and the names that there are."""
    text, _, where = text.partition(" - at `$")
    steps, found, data = _follow(where.removesuffix("`"), data, kind, hook)
    for pattern, problem in ((_UNKNOWN, "unknown key"), (_MISSING, "is missing")):
        if match := pattern.fullmatch(text):
            names = [field.encode_name for field in found.fields] if isinstance(found, inspect.StructType) else []
            hint = suggest_names(match[1], names) if pattern is _UNKNOWN else ""
            known = f"; expected {', '.join(names)}" if pattern is _UNKNOWN and not hint else ""
            return f"{_join(place, *steps, match[1])}: {problem}{hint}{known}"
    if text.startswith("Expected"):
        got = "an object" if isinstance(data, Mapping) else "a list" if isinstance(data, list) else reprlib.repr(data)
        expected = _TYPES.sub(_name_types, text.partition(", got")[0])
        text = f"{expected}, got {'nothing' if data is None else got}"
    elif match := _CHOICE.fullmatch(text):
        choices = list(_list_choices(found))
        text = f"expected one of {', '.join(choices)}, got {match[1]}{suggest_names(match[1].strip(chr(39)), choices)}"
    return f"{_join(place, *steps) or 'the file'}: {text[:1].lower()}{text[1:]}"


def _name_types(match: re.Match[str]) -> str:
    """Types of msgspec in words: ``float | null`` is a number."""
    return " or ".join(_WORDS.get(name, name) for name in match[1].split(" | ") if name != "null")


def _list_choices(kind: inspect.Type) -> Iterator[str]:
    if isinstance(kind, inspect.UnionType):
        for member in kind.types:
            yield from _list_choices(member)
    elif isinstance(kind, inspect.LiteralType):
        yield from map(str, kind.values)
    elif isinstance(kind, inspect.EnumType):
        yield from (str(member.value) for member in kind.cls)


def _join(*names: str) -> str:
    return "".join(name if name.startswith("[") else f".{name}" for name in names if name).removeprefix(".")


def _follow(path: str, data: Any, kind: Any, hook: Hook | None) -> tuple[list[str], inspect.Type, Any]:
    """The steps of a path of msgspec, with keys of dicts in place of its ``[...]``; the type and value at its end."""
    steps: list[str] = []
    found = inspect.type_info(kind)
    for key, index in _STEP.findall(path):
        found = _choose(found, data)
        if index and index != "...":
            steps.append(f"[{index}]")
            data, found = data[int(index)], getattr(found, "item_type", inspect.AnyType())
        elif index:
            inner = found.value_type if isinstance(found, inspect.DictType) else inspect.AnyType()
            name = next(_list_refused(data, inner, hook), "")
            steps.append(name)
            data, found = data.get(name) if isinstance(data, Mapping) else None, inner
        else:
            steps.append(key)
            fields = found.fields if isinstance(found, inspect.StructType) else ()
            types = {field.encode_name: field.type for field in fields}
            data, found = (data.get(key) if isinstance(data, Mapping) else None), types.get(key, inspect.AnyType())
    return steps, _choose(found, data), data


def _list_refused(data: Any, kind: inspect.Type, hook: Hook | None) -> Iterator[str]:
    cls = kind.cls if isinstance(kind, inspect.StructType) else None
    for name, value in data.items() if isinstance(data, Mapping) else ():
        try:
            if cls is not None:
                msgspec.convert(value, cls, dec_hook=_hook(hook))
        except msgspec.ValidationError:
            yield str(name)


def _choose(kind: inspect.Type, data: Any) -> inspect.Type:
    """The member of a union that a value is meant as: the one of its tag, or the only object."""
    while isinstance(kind, inspect.Metadata):
        kind = kind.type
    if not isinstance(kind, inspect.UnionType):
        return kind
    objects = [member for member in kind.types if isinstance(member, inspect.StructType)]
    for member in objects:
        if isinstance(data, Mapping) and member.tag_field and data.get(member.tag_field) == member.tag:
            return member
    if isinstance(data, list):
        return next((member for member in kind.types if isinstance(member, inspect.ListType)), kind)
    return objects[0] if len(objects) == 1 else kind
