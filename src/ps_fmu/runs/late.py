"""Functions whose modules are imported when they are called: what declares them costs nothing to import."""

from __future__ import annotations

from importlib import import_module
from typing import Any


def import_and_call(module: str, function: str, *args: Any, **options: Any) -> Any:
    """Call a function of a module that is imported only now, so that a declaration costs nothing."""
    return getattr(import_module(module), function)(*args, **options)
