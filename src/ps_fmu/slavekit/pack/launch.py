"""The launcher in front of pythonfmu's library: file names within an FMU, and what the launcher has to know."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ...native import list_platforms, read_compiled
from .errors import BuildError
from .sources import Files

OLDEST_PYTHON = "3.11"
_WRAPPER = {".so": "libpythonfmu-export.so", ".dll": "pythonfmu-export.dll"}  # names that the launcher looks for


def put_launcher_in_front(files: Files, model: str) -> Files:
    """The files in ``binaries``: where there is a launcher, it takes the name that hosts look for, ``model``.

    pythonfmu's libraries stay as they are, under the name that the launcher looks for.  Raises BuildError if a launcher
    is not the one that was recorded when it was made: in an FMU nobody could tell.
    """
    result = {name: content for name, content in files.items() if name.parts[0] == "binaries"}
    try:
        for platform in list_platforms("launcher"):
            for name in [name for name in result if name.parent.name == platform and name.stem == model]:
                result[name.with_name(_WRAPPER[name.suffix])] = result[name]
                _, result[name] = read_compiled("launcher", platform)
    except OSError as error:
        raise BuildError(str(error)) from error
    return result


def write_notes(guid: str, modules: Sequence[str], interpreter: Path | None) -> bytes:
    """What the launcher has to know: which FMU this is, and what a Python has to have for it."""
    lines = [f"guid={guid}", f"python={OLDEST_PYTHON}"]
    if modules:
        lines.append(f"modules={' '.join(modules)}")
    if interpreter is not None:
        lines.append(f"interpreter={interpreter.absolute()}")
    return ("\n".join(lines) + "\n").encode()
