"""The pages of the Python API, made of api.toml: one for each group of objects that a user may rely on."""

from __future__ import annotations

import inspect
import tomllib
from collections.abc import Iterator, Mapping
from operator import attrgetter
from pathlib import Path
from pkgutil import resolve_name
from typing import Any

GROUPS: list[dict[str, Any]] = tomllib.loads(Path(__file__).with_name("api.toml").read_text(encoding="utf-8"))["group"]


def write_pages(folder: Path) -> None:
    """Write ``index.rst`` and a page for each group into a folder that exists."""
    index = [
        *_head("Python API", "="),
        "Which objects may a script rely on?  Those of the table.  ``import ps_fmu`` loads nothing but what is used.",
        "Arrays are those of numpy, values are in SI units unless a name or text says otherwise.",
        *("", ".. toctree::", "   :hidden:", "", *(f"   {group['page']}" for group in GROUPS), ""),
    ]
    for group in GROUPS:
        index += ["", f":doc:`{group['title']} <{group['page']}>`", "", *_tabulate(group)]
        (folder / f"{group['page']}.rst").write_text("\n".join(_write_group(group)) + "\n", encoding="utf-8")
    (folder / "index.rst").write_text("\n".join(index) + "\n", encoding="utf-8")


def _write_group(group: Mapping[str, Any]) -> Iterator[str]:
    yield from (*_head(group["title"], "="), group["about"], *_tabulate(group))
    yield from (*_head("Example", "-"), group["example"])
    yield from _head("Objects", "-")
    for entry in group["objects"]:
        name, colon, members = entry.partition(":")
        kind = "autoclass" if inspect.isclass(resolve_name(name)) else "autofunction"
        wanted = kind == "autoclass" and (members or not colon)  # a colon alone: no members
        yield from ("", f".. {kind}:: {name}", *([f"   :members:{members}"] if wanted else []))
    yield from ("", *_head("See also", "-"), ", ".join(f":doc:`/{guide}`" for guide in group["guides"]))


def _tabulate(group: Mapping[str, Any]) -> Iterator[str]:
    yield from (".. autosummary::", "")
    yield from (f"   ~{entry.partition(':')[0]}" for entry in group["objects"])
    yield ""


def _head(text: str, line: str) -> tuple[str, str, str]:
    return text, line * len(text), ""


def list_objects() -> dict[str, str]:
    """Where each object is defined, and the name that its page has for it."""
    names = [entry.partition(":")[0] for group in GROUPS for entry in group["objects"]]
    return {".".join(attrgetter("__module__", "__qualname__")(resolve_name(name))): name for name in names}


def link_guides(guide: str, text: str) -> str:
    """The text of a guide with links to the groups that name it, such as ``docs/budget``."""
    links = [f"{{doc}}`{group['title']} </docs/api/{group['page']}>`" for group in GROUPS if guide in group["guides"]]
    return f"{text}\n**In Python:** {', '.join(links)}\n" if links else text
