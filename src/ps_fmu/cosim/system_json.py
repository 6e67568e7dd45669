"""A flat system as JSON, to be rebuilt on another machine without the files that it was read from.

It has all that decides a run: components, start values, connections with the conversions on their way, inputs and
outputs of the system.  It has no paths and no lines: the same system in another folder is the same text.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path, PurePosixPath
from typing import Any

import msgspec

from ..files.plain import read_bytes
from .errors import SystemFileError
from .structure import Component, System
from .values import Hop

MAXIMUM_BYTES = 2**30

WHERE = "the system of the study"
"""Instead of files and lines, in messages."""


def encode_system(system: System, files: Mapping[str, str]) -> bytes:
    """The system as JSON; ``files``: what the FMU of each component is called there, by the name of the component."""
    plain = replace(
        system, path=Path(WHERE), labels={}, unpacked=None, remarks=(),
        components=tuple(_simplify(one, files[one.name]) for one in system.components),
        connections=tuple(replace(one, line=0, file=WHERE, hops=_forget(one.hops)) for one in system.connections),
        inputs=tuple(
            replace(one, line=0, targets=tuple((port, _forget(hops)) for port, hops in one.targets))
            for one in system.inputs
        ),
        outputs=tuple(replace(one, line=0, hops=_forget(one.hops)) for one in system.outputs),
    )  # fmt: skip
    return msgspec.json.format(msgspec.json.encode(plain, enc_hook=str), indent=1)


def decode_system(path: Path) -> System:
    """The system that :func:`encode_system` has written into a file, beside which its FMUs are.

    Raises :class:`SystemFileError` for a file that is not there or damaged, or names an FMU outside its folder.
    """

    def find_inside(_kind: type, name: Any) -> Path:
        place = PurePosixPath(name)
        if place.is_absolute() or ".." in place.parts:
            raise ValueError(f"{name!r} is not a path inside the folder")
        return (path.parent / place).absolute()

    content = read_bytes(path, MAXIMUM_BYTES)
    try:
        return replace(msgspec.json.decode(content, type=System, dec_hook=find_inside), path=Path(WHERE))
    except (ValueError, TypeError, RecursionError) as error:
        raise SystemFileError(path, f"is no system of a study: {error!r}") from error


def _simplify(component: Component, source: str) -> Component:
    """A component without what only messages need."""
    connectors = tuple(replace(one, line=0) for one in component.connectors)
    entries = component.parameters.items()
    parameters = {
        name: replace(entry, origin=WHERE, notes=frozenset(), hops=_forget(entry.hops)) for name, entry in entries
    }
    return replace(component, source=Path(source), connectors=connectors, parameters=parameters, line=0)


def _forget(hops: Sequence[Hop]) -> tuple[Hop, ...]:
    return tuple(replace(hop, where=WHERE) for hop in hops)
