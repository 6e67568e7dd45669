"""Files that people write, in TOML or JSON, as objects of a :class:`msgspec.Struct`.

The fields of the class are the keys: their types, defaults and bounds (:class:`msgspec.Meta`) are the rules of a file.
An error names the file and the key, and suggests a key that is spelt nearly so.
"""

from __future__ import annotations

import json
import re
import tomllib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import msgspec
from msgspec import inspect

from .errors import SystemFileError
from .structure import suggest_names
from .xmlfile import read_bytes

MAXIMUM_BYTES = 4 * 2**20
T = TypeVar("T")
Hook = Callable[[type, Any], Any]
"""Makes a value of a type that msgspec does not know, as a quantity with a unit; raises ValueError with the reason."""
_STEP = re.compile(r"\.([^.\[\]]+)|\[(\d+|\.\.\.)\]")
_UNKNOWN = re.compile(r"Object contains unknown field `(.*)`", re.DOTALL)
_MISSING = re.compile(r"Object missing required field `(.*)`", re.DOTALL)
_CHOICE = re.compile(r"Invalid enum value (.*)", re.DOTALL)


def read_document(path: Path, kind: type[T], hook: Hook | None = None) -> T:
    """The content of a file, TOML or (``.json``) JSON, as an object of ``kind``.

    Raises :class:`.errors.SystemFileError`: it cannot be read, or a key or value is not as ``kind`` has it.
    """
    return convert_document(load_document(path), kind, path, hook)


def load_document(path: Path) -> Any:
    """The content of a file as dicts, lists and values.  Raises as :func:`read_document`."""
    try:
        text = read_bytes(path, MAXIMUM_BYTES).decode("utf-8-sig")  # some editors begin a file with a mark
        if path.suffix.lower() == ".json":
            return json.loads(text, object_pairs_hook=_refuse_repeated)
        return tomllib.loads(text)
    except RecursionError:
        raise SystemFileError(path, "its values are nested too deeply") from None
    except ValueError as error:
        form = "JSON" if path.suffix.lower() == ".json" else "TOML"
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


def _explain(text: str, data: object, kind: Any, hook: Hook | None, place: str) -> str:
    """What msgspec says, in the words of a file: the key first, and the names that there are."""
    text, _, where = text.partition(" - at `$")
    steps, found = _follow(where.removesuffix("`"), data, kind, hook)
    for pattern, problem in ((_UNKNOWN, "unknown key"), (_MISSING, "is missing")):
        if match := pattern.fullmatch(text):
            names = [field.encode_name for field in found.fields] if isinstance(found, inspect.StructType) else []
            hint = suggest_names(match[1], names) if pattern is _UNKNOWN else ""
            known = f"; expected {', '.join(names)}" if pattern is _UNKNOWN and not hint else ""
            return f"{_join(place, *steps, match[1])}: {problem}{hint}{known}"
    if match := _CHOICE.fullmatch(text):
        choices = list(_list_choices(found))
        text = f"expected one of {', '.join(choices)}, got {match[1]}{suggest_names(match[1].strip(chr(39)), choices)}"
    return f"{_join(place, *steps) or 'the file'}: {text[:1].lower()}{text[1:]}"


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


def _follow(path: str, data: Any, kind: Any, hook: Hook | None) -> tuple[list[str], inspect.Type]:
    """The steps of a path of msgspec, with keys of dicts in place of its ``[...]``, and the type at its end."""
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
    return steps, _choose(found, data)


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
