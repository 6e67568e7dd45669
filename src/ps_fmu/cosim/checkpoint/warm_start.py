"""A run that begins in the state of another one, with other values where that is possible."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Mapping
from copy import copy
from pathlib import Path

import numpy as np
from fmpy.model_description import ModelDescription

from ..description import DISCRETE_TYPES, convert_value, explain_unsettable, find_variable, read_start
from ..errors import UsageError
from ..graph import Wiring
from ..schemes.resolving import find_period
from ..schemes.scheme import Scheme
from ..structure import PortName, System
from ..values import Value
from ..wires import Assembly
from .files import CheckpointFolder, read_file, write_file
from .parts import (
    find_difference,
    find_port,
    identify_system,
    list_columns,
    list_inputs,
    list_starts,
    load_fmu,
    load_scheme,
    load_values_set,
)
from .state import Array, CheckpointError, DamagedCheckpointError, State

NEEDED = ("run", "index", "fmus", "latest", "set", "repeated", "faults", "scheme")
"""What a run that begins here takes of a checkpoint; the rows before it, and what observers have seen, are not."""


class WarmStart:
    """Has a run begin in the state of a checkpoint, at its time.

    The master is made with the ``start_time`` of :attr:`time` and its own start values.  Where these are not those of
    the checkpoint's run, inputs and tunable parameters are set, as by an event there.  A fixed parameter is in the
    state of its FMU and cannot change, unless that FMU begins ``anew``: it is initialised with its new values at that
    time, gets the outputs of the others, and has none of its state of before.  Inputs over time are those of this run.
    Lines of extrapolated inputs go on; all begin anew where an FMU does, or where an input over time is another one or
    has another value than there.  Faults of the other run are over.  Other variables may be recorded than there: what
    the checkpoint lacks is read of the FMUs.

    Nothing of it is changed by a run: many can begin from one.

    Parameters
    ----------
    path: file of a checkpoint, or a folder of which the last one is taken
    anew: components that begin anew
    given: inputs and tunable parameters, ``component.variable``, that begin with their start value in any case; others
        keep what an event of the other run has set, unless their start value is another one than there

    Raises :class:`CheckpointError`: there is no checkpoint, or it is damaged.
    """

    def __init__(self, path: Path, anew: Collection[str] = (), given: Collection[str] = ()) -> None:
        self._anew, self._given = frozenset(anew), frozenset(given)
        if path.is_dir():
            found = CheckpointFolder(path).read()
            if found is None:
                raise CheckpointError(f"{path}: there is no checkpoint in this folder: make it by --checkpoint")
            self.path, kept = found
        else:
            self.path, kept = path, read_file(path)
        self._kept = {name: value for name, value in kept.items() if name in NEEDED}
        try:
            run = self._kept["run"]
            self.time: float = float(run["start"]) + int(self._kept["index"]) * float(run["step"])
            """Of the checkpoint [s]."""
            if not math.isfinite(self.time):
                raise ValueError(f"a time of {self.time} s")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise self._make_damaged(error) from error

    def giving(self, given: Collection[str]) -> WarmStart:
        """The same, with other values that are given."""
        other = copy(self)
        other._given = frozenset(given)
        return other

    def write(self, path: Path) -> None:
        """Write what is needed of the checkpoint, a fraction of it, into a file to begin from.  Raises OSError."""
        write_file(path, self._kept)

    def get_start(self, name: str) -> Value | None:
        """Start value of ``component.variable`` in the run of the checkpoint; None where its FMU's own one was left."""
        starts = self._kept["run"].get("starts")
        value = starts.get(name) if isinstance(starts, dict) else None
        return value if isinstance(value, bool | int | float | str) else None

    def check(
        self, system: System, wiring: Wiring, descriptions: Mapping[str, ModelDescription], step: float, scheme: Scheme
    ) -> None:
        """Raises what :meth:`apply` would of a system that begins here, before anything is loaded; OSError.

        ``step`` [s]; ``scheme``: resolved for the system.
        """
        self._check_anew([component.name for component in system.components])
        try:
            self._check_system(identify_system(system, wiring, step, scheme), scheme, step)
            self._find_changes(system, list_starts(wiring), descriptions)
        except UsageError:  # what is wrong is a value of this run
            raise
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, OverflowError) as error:
            raise self._make_damaged(error) from error

    def apply(self, parts: Assembly) -> None:
        """Bring an initialised master into the state; its row 0 is that of the checkpoint.

        Raises :class:`CheckpointError` for a checkpoint of another system, or a value that cannot change;
        :class:`SlaveError`: an FMU refuses its state or a value.
        """
        self._check_anew(parts.instances)
        try:
            identity = identify_system(parts.system, parts.wiring, parts.clock.step, parts.scheme)
            self._check_system(identity, parts.scheme, parts.clock.step)
            changes = self._find_changes(parts.system, list_starts(parts.wiring), parts.descriptions)
            time = parts.clock.start
            for name in parts.instances.keys() - self._anew:
                load_fmu(parts, name, self._kept["fmus"][name])
            latest = self._read_latest(parts, time)
            parts.rows.restore(0, parts.rows.block[:0], latest)
            kept = self._kept["set"].items()
            values = {name: value for name, value in kept if find_port(parts, name).component not in self._anew}
            load_values_set(parts, {"set": values, "repeated": self._kept["repeated"]})
            if not self._anew and self._keeps_inputs(parts):
                load_scheme(parts, {**self._kept, "latest": latest})
            bases = {find_port(parts, name): value for name, value in self._kept["faults"]["bases"].items()}
            for port, value in {**bases, **changes}.items():
                if port.component not in self._anew:
                    parts.instances[port.component].set({port.variable: value}, time)
            self._feed_new(parts, time)
            parts.rows.store_latest()
        except UsageError:
            raise
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, OverflowError) as error:
            raise self._make_damaged(error) from error

    def _check_anew(self, components: Collection[str]) -> None:
        if unknown := sorted(self._anew - set(components)):
            raise CheckpointError(f"anew: there is no component {unknown[0]!r}; there are {', '.join(components)}")

    def _check_system(self, identity: Mapping[str, State], scheme: Scheme, step: float) -> None:
        """Raises :class:`CheckpointError` for a checkpoint of another system."""
        if difference := find_difference(identity, self._kept["run"]):
            raise CheckpointError(f"{self.path}: belongs to another system: {difference}")
        self._check_rates(scheme, step)

    def _find_changes(
        self, system: System, own: Mapping[str, State], descriptions: Mapping[str, ModelDescription]
    ) -> Mapping[PortName, State]:
        """Start values that are other ones than in the checkpoint's run, and can be set now."""
        kept, events = self._kept["run"]["starts"], self._kept["set"]
        changes: dict[PortName, State] = {}
        refused, fixed = [], set()
        for name in sorted({*own, *kept, *(self._given & events.keys())}):
            port = system.find_port(name)
            was_set = name in self._given and name in events
            if port.component in self._anew or (own.get(name) == kept.get(name) and not was_set):
                continue
            variable = find_variable(descriptions[port.component], port.variable)
            default = read_start(variable)
            value = convert_value(variable, own.get(name, default))
            there = convert_value(variable, events[name] if was_set else kept.get(name, default))
            if value == there:
                continue
            if reason := explain_unsettable(variable, True):
                refused.append(f"{name} {reason}; its value is {there} in the checkpoint and {value} in this run")
                fixed.add(port.component)
            else:
                changes[port] = value
        if refused:
            anew = shlex.join(sorted(fixed))
            raise CheckpointError(
                f"{self.path}: these values are part of the states of the FMUs and cannot change:\n"
                + "\n".join(f"- {text}" for text in refused)
                + f"\nKeep these values, or initialise these FMUs again, without their states: --anew {anew}"
            )
        return changes

    def _check_rates(self, scheme: Scheme, step: float) -> None:
        """Raises :class:`CheckpointError` where a component is within a step of its own: rates begin anew here."""
        period, index = find_period(scheme), int(self._kept["index"])
        if index % period:
            raise CheckpointError(
                f"{self.path}: lies within a step of a component, after step {index} of its run.\n"
                f"  Begin from a checkpoint at a multiple of {period * step:.9g} s ({period} steps)."
            )

    def _read_latest(self, parts: Assembly, time: float) -> Array:
        """The outputs at the checkpoint, as they lie in the rows of this run.

        Inputs of the run stay what the first row has: what the file of this run says of that time.
        """
        there, rows = self._index_latest(), parts.rows
        given = {signal.column for signal in parts.signals}
        reals = len(rows.real.places)
        every = parts.run_columns.every[: rows.latest.size]  # those that are computed come last
        for place, column in enumerate(every):
            kind, own = (rows.real, place) if place < reals else (rows.discrete, place - reals)
            (name,) = list_columns([column])
            if column in given:
                continue
            if name in there:
                kind.values[own] = there[name]
            elif not column.component:
                raise CheckpointError(f"{self.path}: belongs to another system: its run did not record {column.name!r}")
            else:
                variable = column.name.removeprefix(f"{column.component}.")
                kind.values[own] = parts.instances[column.component].get([variable], time)[variable]
        return rows.latest.copy()

    def _keeps_inputs(self, parts: Assembly) -> bool:
        """Whether the inputs over time are those of the checkpoint's run, with the values that they had there."""
        own, there = list_inputs(parts), self._index_latest()
        places = [parts.rows.find_place(signal.port) for signal in parts.signals]
        now = [values[place] for values, place in places]
        return own == self._kept["run"]["inputs"] and [there[name] for name in own] == now

    def _index_latest(self) -> dict[str, float | int]:
        """The outputs in the checkpoint by name, unit and type of their columns: Reals, then C ints side by side."""
        latest, names = self._kept["latest"], self._kept["run"]["columns"]
        if latest.dtype != np.float64 or latest.ndim != 1 or latest.size > len(names):
            raise ValueError(f"outputs of the shape {latest.shape}")
        names = names[: latest.size]
        discrete = [name for name in names if name.endswith(tuple(f" {kind}" for kind in DISCRETE_TYPES))]
        reals = len(names) - len(discrete)
        if names[reals:] != discrete:
            raise ValueError("its columns are in a wrong order")
        whole = latest[reals:].view(np.int32)[: len(discrete)]
        return dict(zip(names, [*latest[:reals].tolist(), *whole.tolist()], strict=True))

    def _feed_new(self, parts: Assembly, time: float) -> None:
        """Give FMUs that begin anew the outputs of the others, and take theirs."""
        for connection in parts.wiring.connections:
            target, source = connection.target, connection.source
            if target.component in self._anew and target not in parts.values_set:
                value = parts.instances[source.component].get([source.variable], time)[source.variable]
                conversion = parts.wiring.conversions.get(target)
                value = value if conversion is None else conversion.apply(value)
                parts.instances[target.component].set({target.variable: value}, time)
        for kind in (parts.rows.real, parts.rows.discrete):
            for port, place in kind.places.items():
                if port.component in self._anew:
                    kind.values[place] = parts.instances[port.component].get([port.variable], time)[port.variable]

    def _make_damaged(self, error: Exception) -> CheckpointError:
        return DamagedCheckpointError(self.path, f"is damaged: {error!r}")
