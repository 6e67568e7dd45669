"""Compiled files of this package: only one that was recorded when it was made is loaded, run or packed.

A library that was cut short ends the process when it is loaded, one of another version when it is called.  Beside the
sources lies the record, which says what was made for each platform of FMI, see ``slavekit/launcher/c_program.py``.
"""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

_AGAIN = "install ps_fmu again, or after changes of its C sources run 'make launcher'"


def find_whole(record: Path, platform: str) -> Path:
    """The compiled file for a platform (``linux64``, ...), which is the recorded one.  Raises as :func:`read_whole`."""
    return _read(record, platform)[0]


def read_whole(record: Path, platform: str) -> bytes:
    """The content of the compiled file for a platform.

    Raises OSError: the record or the file is missing or damaged, or they do not belong together.
    """
    return _read(record, platform)[1]


def _read(record: Path, platform: str) -> tuple[Path, bytes]:
    try:
        content = json.loads(record.read_bytes())
        path = record.parent / platform / content["targets"][platform]["result"]
        expected = content["made"][platform]
    except (ValueError, LookupError, TypeError) as error:
        raise OSError(f"{record}: is damaged, or says nothing of {platform} ({error!r}): {_AGAIN}") from error
    data = path.read_bytes()
    found = hashlib.sha256(data).hexdigest()
    if found != expected:
        raise OSError(
            f"{path}: is damaged, or of another version: its SHA-256 is {found}, {record.name} has {expected}: {_AGAIN}"
        )
    return path, data
