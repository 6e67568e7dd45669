"""Files that String parameters name: inside the FMU, where they were packed with it, or else where the host runs.

A packed file lies in ``resources/files`` of the FMU, and the parameter is ``files/NAME``: the same text in every tool
and on every machine.  A text may also be a JSON list of objects some of whose values name files.
"""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Mapping
from typing import TypeVar

FOLDER = "files"
"""In the resources of an FMU."""

T = TypeVar("T")


def change_names(text: str, change: Callable[[str], str]) -> str:
    """The text with the name of each file replaced; ``change`` maps each text that may be a name to the new one."""
    if not text.startswith("[{"):
        return change(text)
    try:
        tables = json.loads(text)
    except (ValueError, RecursionError):
        return text  # refused by whom it is for
    changed = [
        {key: change(value) if isinstance(value, str) else value for key, value in table.items()}
        if isinstance(table, dict)
        else table
        for table in tables
    ]
    return text if changed == tables else json.dumps(changed)


def find_packed(values: Mapping[str, T], resources: str | None) -> dict[str, T | str]:
    """The values, with the absolute paths of files that are packed in the resources of an FMU."""

    def find(text: str) -> str:
        path = os.path.join(resources or "", text)
        return path if text.startswith(f"{FOLDER}/") and resources and os.path.isfile(path) else text

    return {name: change_names(value, find) if isinstance(value, str) else value for name, value in values.items()}
