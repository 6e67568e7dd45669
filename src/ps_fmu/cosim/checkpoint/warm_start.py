"""A run that begins in the state of another one, with other values where that is possible."""

from __future__ import annotations

import math
import shlex
from collections.abc import Collection, Mapping
from pathlib import Path

from ..description import convert_value, explain_unsettable, find_variable, read_start
from ..errors import UsageError
from ..schemes.resolving import find_period
from ..structure import PortName
from .files import read_file
from .folder import CheckpointFolder
from .parts import MasterParts, find_difference
from .state import CheckpointError, State


class WarmStart:
    """Has a run begin in the state of a checkpoint, at its time.

    The master is made with the ``start_time`` of :attr:`time` and its own start values.  Where these are not those of
    the checkpoint's run, inputs and tunable parameters are set, as by an event there.  A fixed parameter is in the
    state of its FMU and cannot change, unless that FMU begins ``anew``: it is initialised with its new values at that
    time, gets the outputs of the others, and has none of its state of before.  Lines of inputs go on, or begin anew
    where an FMU does.  Faults of the other run are over.

    Parameters
    ----------
    path: file of a checkpoint, or a folder of which the last one is taken
    anew: components that begin anew

    Raises :class:`CheckpointError`: there is no checkpoint, or it is damaged.
    """

    def __init__(self, path: Path, anew: Collection[str] = ()) -> None:
        self._anew = frozenset(anew)
        if path.is_dir():
            found = CheckpointFolder(path).read()
            if found is None:
                raise CheckpointError(f"{path}: there is no checkpoint in this folder")
            self.path, self._kept = found
        else:
            self.path, self._kept = path, read_file(path)
        try:
            run = self._kept["run"]
            self.time: float = float(run["start"]) + int(self._kept["index"]) * float(run["step"])
            """Of the checkpoint [s]."""
            if not math.isfinite(self.time):
                raise ValueError(f"a time of {self.time} s")
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            raise self._make_damaged(error) from error

    def apply(self, parts: MasterParts) -> None:
        """Bring an initialised master into the state; its row 0 is that of the checkpoint.

        Raises :class:`CheckpointError` for a checkpoint of another system, or a value that cannot change;
        :class:`SlaveError`: an FMU refuses its state or a value.
        """
        if unknown := sorted(self._anew - parts.instances.keys()):
            raise UsageError(f"anew: there is no component {unknown[0]!r}; there are {', '.join(parts.instances)}")
        try:
            own = parts.identify()
            free = {name: own[name] for name in ("start", "faults")}
            if difference := find_difference(own, {**self._kept["run"], **free}):
                raise CheckpointError(f"{self.path}: is of another system: {difference}")
            self._check_rates(parts)
            changes = self._find_changes(parts)
            time = parts.clock.start
            for name in parts.instances.keys() - self._anew:
                parts.load_fmu(name, self._kept["fmus"][name])
            parts.rows.restore(0, parts.rows.block[:0], self._check_latest(parts))
            kept = self._kept["set"].items()
            values = {name: value for name, value in kept if parts.find_port(name).component not in self._anew}
            parts.load_values_set({"set": values, "repeated": self._kept["repeated"]})
            if not self._anew:
                parts.load_scheme(self._kept)
            bases = {parts.find_port(name): value for name, value in self._kept["faults"]["bases"].items()}
            for port, value in {**bases, **changes}.items():
                if port.component not in self._anew:
                    parts.instances[port.component].set({port.variable: value}, time)
            self._feed_new(parts, time)
            parts.rows.store_latest()
        except (KeyError, ValueError, TypeError, AttributeError, IndexError, OverflowError) as error:
            raise self._make_damaged(error) from error

    def _find_changes(self, parts: MasterParts) -> Mapping[PortName, State]:
        """Start values that are other ones than in the checkpoint's run, and can be set now."""
        own, kept = parts.list_starts(), self._kept["run"]["starts"]
        changes: dict[PortName, State] = {}
        refused, fixed = [], set()
        for name in sorted({*own, *kept}):
            port = parts.find_port(name)
            if port.component in self._anew or own.get(name) == kept.get(name):
                continue
            variable = find_variable(parts.descriptions[port.component], port.variable)
            default = read_start(variable)
            value, there = (convert_value(variable, found.get(name, default)) for found in (own, kept))
            if value == there:
                continue
            if reason := explain_unsettable(variable, True):
                refused.append(f"{name} {reason}; it is {there} there, {value} here")
                fixed.add(port.component)
            else:
                changes[port] = value
        if refused:
            anew = shlex.join(sorted(fixed))
            raise CheckpointError(
                f"{self.path}: these values are in the states of the FMUs and cannot change:\n"
                + "\n".join(f"- {text}" for text in refused)
                + f"\nLeave them as they are there, or have these FMUs begin anew, without their state: --anew {anew}"
            )
        return changes

    def _check_rates(self, parts: MasterParts) -> None:
        """Raises :class:`CheckpointError` where a component is within a step of its own: rates begin anew here."""
        period, index = find_period(parts.scheme), int(self._kept["index"])
        if index % period:
            raise CheckpointError(
                f"{self.path}: is within a step of a component: rates come round after {period} steps, and it is at "
                f"step {index} of its run.  Begin from a checkpoint at a multiple of {period * parts.clock.step:.9g} s"
            )

    def _check_latest(self, parts: MasterParts) -> State:
        latest = self._kept["latest"]
        if latest.shape != parts.rows.latest.shape or latest.dtype != parts.rows.latest.dtype:
            raise ValueError(f"outputs of the shape {latest.shape}")
        return latest

    def _feed_new(self, parts: MasterParts, time: float) -> None:
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
        return CheckpointError(f"{self.path}: is a damaged checkpoint: {error!r}")
