"""What a checkpoint takes of a master, how it is given back, and what has to be the same for that."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from ... import __version__
from ..errors import UsageError
from ..graph import Wiring
from ..rows import Column
from ..schemes.making import plan_steps
from ..schemes.scheme import Scheme
from ..structure import PortName, System
from ..wires import Assembly
from .state import CheckpointError, State

_ABILITIES = {"canGetAndSetFMUstate": "save its state", "canSerializeFMUstate": "write its state into a file"}


def check_abilities(parts: Assembly) -> None:
    """Raises :class:`CheckpointError` for an FMU whose state cannot be written into a file."""
    for name, description in parts.descriptions.items():
        for ability, lack in _ABILITIES.items():
            if not getattr(description.coSimulation, ability):
                raise CheckpointError(
                    f"{name}: no checkpoints are possible: the FMU cannot {lack} ({ability} is false).\n"
                    "  Run without checkpoints, or export the FMU with states, if its tool has an option for that."
                )


def find_port(parts: Assembly, name: str) -> PortName:
    """A variable by its name in a checkpoint.  Raises ValueError if there is none."""
    try:
        port = parts.system.find_port(name)
    except UsageError as error:
        raise ValueError(str(error)) from error
    if port.variable not in parts.instances[port.component].variables:
        raise ValueError(f"there is no variable {port}")
    return port


def identify(parts: Assembly) -> dict[str, State]:
    """What a checkpoint and the run that goes on from it have in common."""
    return {
        **identify_system(parts.system, parts.wiring, parts.clock.step, parts.scheme),
        "start": parts.clock.start,
        "columns": list_columns(parts.run_columns.every),
        "inputs": list_inputs(parts),
        "faults": parts.faults.identify(),
    }


def list_inputs(parts: Assembly) -> dict[str, State]:
    """The inputs of the run over time, as columns, with what each is fed into."""
    return {
        text: [str(port) for port, _ in signal.targets]
        for signal in parts.signals
        for text in list_columns([signal.column])
    }


def save_fmus(parts: Assembly) -> dict[str, State]:
    """The states of all FMUs as bytes, with what the user has been told of each.  Raises :class:`SlaveError`."""
    return {
        name: {
            "state": instance.write_state(),
            "warnings": instance.warnings,
            "shown": instance.messages.list_shown(),
        }
        for name, instance in parts.instances.items()
    }


def load_fmu(parts: Assembly, name: str, kept: Mapping[str, State]) -> None:
    """Give an FMU its state back.  Raises :class:`SlaveError`."""
    instance, state = parts.instances[name], kept["state"]
    if not isinstance(state, bytes):
        raise TypeError(f"the state of {name} is not a row of bytes")
    instance.read_state(state)
    instance.warnings = int(kept["warnings"])
    instance.messages.note_shown(map(str, kept["shown"]))


def save_rows(parts: Assembly) -> dict[str, State]:
    """The rows of the unfinished block, as the FMUs have left them, what was set, and what faults and the scheme
    remember."""
    rows, loop = parts.rows, parts.loop
    return {
        "first": rows.first_index,
        "rows": rows.block[: rows.filled].copy(),
        "latest": rows.latest.copy(),
        "set": {str(port): value for port, value in parts.values_set.items()},
        "repeated": sorted(loop.warned) if loop is not None else [],
        "faults": parts.faults.save_state(),
        "scheme": [memory.save_state() for memory in loop.loop.memories] if loop is not None else [],
    }


def load_rows(parts: Assembly, kept: Mapping[str, State]) -> None:
    """Take over what :func:`save_rows` has saved; the states of FMUs are given back after it."""
    rows, block, latest = parts.rows, kept["rows"], kept["latest"]
    if block.shape[1:] != latest.shape or latest.shape != rows.latest.shape or len(block) > rows.capacity:
        raise ValueError(f"rows of the shape {block.shape}, expected up to {rows.block.shape}")
    if not (block.dtype == latest.dtype == np.float64) or int(kept["first"]) < 0:
        raise ValueError("expected rows of numbers")
    rows.restore(int(kept["first"]), block, latest)
    parts.faults.load_state(kept["faults"])
    load_values_set(parts, kept)
    load_scheme(parts, kept)


def load_values_set(parts: Assembly, kept: Mapping[str, State]) -> None:
    """What was set is set, and the plan of the steps is made for it."""
    values = {find_port(parts, name): value for name, value in kept["set"].items()}
    parts.values_set.clear()
    parts.values_set.update(values)
    plan_steps(parts)
    loop = parts.loop
    if loop is not None:
        loop.warned.update(map(str, kept["repeated"]))


def load_scheme(parts: Assembly, kept: Mapping[str, State]) -> None:
    """Let the scheme remember what it did; the plan of the steps, which begins anew, has been made."""
    loop = parts.loop
    assert loop is not None
    for memory, state in zip(loop.loop.memories, kept["scheme"], strict=True):
        memory.load_state(state)
    parts.rows.latest[:] = kept["latest"]  # a new plan has set the columns of the scheme to 0


def identify_system(system: System, wiring: Wiring, step: float, scheme: Scheme) -> dict[str, State]:
    """What any run from a checkpoint has in common with the run of it.  Raises OSError."""
    return {
        "package": __version__,
        "step": step,
        "scheme": _describe_scheme(scheme),
        "fmus": {component.name: hash_file(component.source) for component in system.components},
        "connections": _list_wires(wiring),
    }


def list_starts(wiring: Wiring) -> dict[str, State]:
    """Start values by component.variable."""
    return {f"{name}.{v}": value for name, own in wiring.starts.items() for v, value in own.items()}


def list_columns(columns: Iterable[Column]) -> list[str]:
    """What is recorded, in order: name, unit and type."""
    return [f"{column.name} {column.unit} {column.type}" for column in columns]


def find_difference(own: Mapping[str, Any], kept: Mapping[str, Any]) -> str | None:
    """In what a run differs from that of a checkpoint, in words; None if in nothing.

    ``own``: of :func:`identify`, or of :func:`identify_system`; more of ``kept`` is not looked at.
    """
    names = {"package": "version of ps_fmu", "step": "step (s)", "scheme": "scheme", "start": "start time (s)"}
    for name, what in names.items():
        if name in own and own[name] != kept.get(name):
            return f"the {what} is {kept.get(name)!r} in the checkpoint and {own[name]!r} in this run"
    fmus = kept.get("fmus")
    if not isinstance(fmus, dict) or own["fmus"].keys() != fmus.keys():
        return f"the components are {', '.join(fmus or ())} in the checkpoint and {', '.join(own['fmus'])} in this run"
    if others := [component for component, found in own["fmus"].items() if found != fmus[component]]:
        return f"the content of the FMU of {', '.join(others)} differs"
    for name, what in (
        ("connections", "the connections differ"),
        ("columns", "the recorded variables differ (--observe, --faults)"),
        ("faults", "the faults differ"),
    ):  # fmt: skip
        if name not in own:
            continue
        here, there = set(own[name]), set(kept.get(name) or ())
        if here != there:
            which = sorted(here ^ there)[0]
            return f"{what}: {which!r} is missing in {'the checkpoint' if which in here else 'this run'}"
        if list(own[name]) != list(kept[name]):
            return f"{what} in their order"
    return None


def _describe_scheme(scheme: Scheme) -> str:
    if not scheme.is_iterated:
        return str(scheme)
    how = scheme.iteration
    return f"{scheme}, by {how.method} to {how.relative!r} or {how.absolute!r} in {how.limit} iterations"


def hash_file(path: Path) -> str:
    """SHA-256 of a file in hexadecimal; one that has not changed is read once.  Raises OSError."""
    found = path.stat()
    return _hash_known(path, (found.st_dev, found.st_ino, found.st_size, found.st_mtime_ns))


@lru_cache(maxsize=256)  # a study begins each case from a checkpoint; FMUs are megabytes, and a MB takes 0.5 ms
def _hash_known(path: Path, _version: tuple[int, ...]) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _list_wires(wiring: Wiring) -> list[str]:
    wires = []
    for connection in wiring.connections:
        conversion = wiring.conversions.get(connection.target)
        how = "" if conversion is None or conversion.changes_nothing else f" by {conversion!r}"
        wires.append(f"{connection.source} -> {connection.target}{how}")
    return wires
