"""Copies of FMUs and other archives with something changed."""

from __future__ import annotations

import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path

DESCRIPTION = "modelDescription.xml"
Change = Callable[[dict[str, bytes]], object]


def rewrite(source: Path, target: Path, *changes: Change) -> Path:
    """A copy of an archive whose files, by name, were changed in place; ``target`` may be a folder, or the source."""
    with zipfile.ZipFile(source) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    for change in changes:
        change(files)
    target = target / source.name if target.is_dir() else target
    with zipfile.ZipFile(target, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)
    return target


def replace(name: str, replacements: Mapping[str, str] | Mapping[bytes, bytes]) -> Change:
    """A change of texts or bytes in a file, each of which is there."""

    def change(files: dict[str, bytes]) -> None:
        for pair in replacements.items():
            old, new = (part.encode() if isinstance(part, str) else part for part in pair)
            assert old in files[name]
            files[name] = files[name].replace(old, new)

    return change


def put(name: str, content: bytes) -> Change:
    """A change that adds a file, or replaces it."""
    return lambda files: files.update({name: content})


def drop(name: str) -> Change:
    """A change that leaves out all files whose names hold this."""

    def change(files: dict[str, bytes]) -> None:
        for found in [member for member in files if name in member]:
            del files[found]

    return change
