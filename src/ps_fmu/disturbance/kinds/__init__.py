"""The kinds of disturbance, a file each: a new file in this folder is a new kind."""

from __future__ import annotations

import importlib
import pkgutil

from ..kind import Kind


def find_kinds() -> list[type[Kind]]:
    """The subclasses of :class:`.Kind` that the files of this folder define, by place and name."""
    modules = [importlib.import_module(f"{__name__}.{found.name}") for found in pkgutil.iter_modules(__path__)]
    kinds = [
        value
        for module in modules
        for value in vars(module).values()
        if isinstance(value, type) and issubclass(value, Kind) and value.__module__ == module.__name__
    ]
    return sorted(kinds, key=lambda kind: (kind.place, kind.name))
