"""Files that String parameters name, packed with the FMU that reads them: see :mod:`...slavekit.author.files`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory

from ...files.archive import extract, make_zip, read_all
from ...slavekit.author.files import FOLDER, change_names, find_packed
from ..structure import Component, Value

_RESOURCES = PurePosixPath("resources")
_PACKED = ".csv"  # a system of somebody else may name any file of this machine
_MARK = _RESOURCES / "launcher.txt"  # of FMUs that look for packed files


@dataclass(frozen=True)
class Packed:
    """Components whose FMUs carry what their parameters name."""

    components: tuple[Component, ...]
    fmus: Mapping[Path, bytes]
    """Content of each FMU by its file."""
    left: tuple[str, ...]
    """A line for each file that stays where it is: not a CSV file, or of an FMU that is not one of ps_fmu."""


def pack_files(components: Iterable[Component]) -> Packed:
    """Put all CSV files that text parameters name into the FMUs; FMUs without any keep their bytes.

    Raises :class:`..errors.SystemFileError` for an FMU, and OSError for a file, that cannot be read.
    """
    files: dict[Path, dict[str, Path]] = {}
    inside: dict[Path, dict[PurePosixPath, bytes]] = {}
    changed: list[Component] = []
    left: list[str] = []
    for component in components:
        own = files.setdefault(component.source, {})

        def pack(text: str, component: Component = component, own: dict[str, Path] = own) -> str:
            if not _is_file(text):
                return text
            if component.source not in inside:
                inside[component.source] = read_all(component.source)
            if not text.endswith(_PACKED) or _MARK not in inside[component.source]:
                why = f"only {_PACKED} files travel" if not text.endswith(_PACKED) else "its FMU cannot carry it"
                left.append(f"{component.name}: {text} stays where it is: {why}")
                return text
            path = Path(text).resolve()
            taken = {name: other for name, other in own.items() if other != path}
            taken |= {name.name: path for name in inside[component.source] if name.parent == _RESOURCES / FOLDER}
            name, number = path.name, 2
            while name in taken:
                name, number = f"{path.stem}_{number}{path.suffix}", number + 1
            own[name] = path
            return f"{FOLDER}/{name}"

        texts = {name: one for name, one in component.parameters.items() if isinstance(one.value, str)}
        named = {name: replace(one, value=change_names(str(one.value), pack)) for name, one in texts.items()}
        changed.append(replace(component, parameters={**component.parameters, **named}))
    fmus = {}
    for source, own in files.items():
        fmus[source] = source.read_bytes()
        if own:
            added = {_RESOURCES / FOLDER / name: path.read_bytes() for name, path in own.items()}
            fmus[source] = make_zip({**inside[source], **added})
    return Packed(tuple(changed), fmus, tuple(left))


def find_values(component: Component) -> dict[str, Value]:
    """Start values of a component, with paths of packed files that this process can open.

    Raises :class:`..errors.SystemFileError` for an FMU that cannot be read.
    """
    values = {name: entry.value for name, entry in component.parameters.items()}
    if not any(isinstance(value, str) and f"{FOLDER}/" in value for value in values.values()):
        return values
    return find_packed(values, _unpack(component.source, component.source.stat().st_mtime_ns).name)


@lru_cache(maxsize=8)
def _unpack(fmu: Path, _changed: int) -> TemporaryDirectory[str]:
    """A folder with the packed files of an FMU, which lives as long as this process."""
    folder: TemporaryDirectory[str] = TemporaryDirectory(prefix="files_")
    prefix = f"{_RESOURCES / FOLDER}/"
    extract(fmu, Path(folder.name), lambda name: name.startswith(prefix))
    (Path(folder.name) / _RESOURCES).mkdir(exist_ok=True)
    for path in (Path(folder.name) / _RESOURCES).iterdir():
        path.rename(Path(folder.name) / path.name)
    return folder


def _is_file(text: str) -> bool:
    try:
        return bool(text) and Path(text).is_file()
    except (OSError, ValueError):  # too long, or with a NUL
        return False
