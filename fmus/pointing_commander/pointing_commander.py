"""PointingCommander: smooth motion to a target orientation with the fine actuators at rest."""

from __future__ import annotations

from collections.abc import Generator
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.control.commander import N_PROFILE, Commander, Decision, from_numbers, same_target, to_numbers
from ps_fmu.control.profile import Profile
from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.kinematics import KinematicsError
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import check_number, take_values
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Commander.from_parameters(load())
RPY = ("roll", "pitch", "yaw")
DEG: dict[str, Any] = {"display_unit": "deg", "nominal": 0.1}
DEG_PER_S: dict[str, Any] = {"display_unit": "deg/s", "nominal": 0.01}
MM: dict[str, Any] = {"display_unit": "mm", "nominal": 0.01}
OUTPUT: dict[str, Any] = {"causality": "output"}
PART = 256  # rows made at once
# The motion begins at rest, wherever the first target is.
AT_REST: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}


class PointingCommander(Slave):
    """Turns the payload platform to a target orientation; refuses what the mechanism cannot reach."""

    model_description = "Pointing commander: coarse actuator commands for a target orientation of P in B"
    physics: ClassVar[type] = Commander
    block_rows: ClassVar[int] = 4096  # a row at rest: 0.06 us, 0.09 us in tables of 1024; in motion 1.3 us
    n_memory: ClassVar[int] = N_PROFILE + 1 + 1 + 3  # profile, reachable, waiting, last target: see _build

    ports: ClassVar[tuple[Port, ...]] = (
        *vector("target", RPY, "rad", "Target orientation of P in B", causality="input", event=True, **DEG),
        # The order of Commander.table, then the two Booleans.
        *numbered(
            "coarse_command", 3, "m", "Commanded displacement of a coarse actuator from its nominal length",
            **OUTPUT, **MM,
        ),
        *vector("orientation_command", RPY, "rad", "Commanded orientation of P in B", **OUTPUT, **DEG),
        *vector("orientation_rate", RPY, "rad/s", "Time derivative of orientation_command", **AT_REST, **DEG_PER_S),
        *vector(
            "platform_position", "xyz", "m", "Commanded position of the origin of P from the origin of B, in B",
            nominal=0.1, **OUTPUT,
        ),
        Port(
            "residual", "output", "m", "Largest deviation of a fine leg from its nominal length at the commanded pose",
            min=0.0, nominal=1e-6, display_unit="um",
        ),
        Port("stroke_margin", "output", "m", "Least distance of the coarse commands from the stroke ends", **MM),
        Port(
            "time_to_go", unit="s", description="Time until the commanded motion ends", min=0.0, nominal=10.0, **AT_REST
        ),
        Port(
            "reachable", "output", type="Boolean",
            description="False: the target is refused; the last reachable one stays",
        ),
        Port("moving", type="Boolean", description="True: the commanded orientation is changing", **AT_REST),
        *make_parameter_ports(DEFAULT),
        Port(
            "command_resolution", "parameter", "m", min=0.0, display_unit="um",
            description="Quantisation step of the coarse commands, as of an encoder or stepper motor; 0 = none",
        ),
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("coarse_actuators", ("coarse_command",), "Commands of the coarse actuators"),
    )

    at_rest: NDArray[np.float64]
    """Rows behind the end of the profile, which are all the same: not computed for each table."""

    def configure(self) -> None:
        """Rest at the initial target."""
        self._build()
        target = self.values("target")
        decision = self.commander.begin(target)
        if decision.refusal is not None:
            self.warning(f"initial target {format_degrees(target)} refused: {decision.refusal}; at the nominal pose")
        self._decide(decision, target)
        self.y[:] = self._outputs(np.zeros(1))[0]

    def event(self, t: float, h: float) -> bool:
        """A new target, or another try of one whose path was unreachable while moving."""
        target = self.values("target")
        waiting = bool(self.waiting[0])
        if same_target(target, self.last_target) and not (waiting and self.profile.remaining(t) == 0.0):
            return waiting
        decision = self.commander.redirect(self.profile, t, target)
        # A host that leads the target out of reach step by step gets one warning.
        if decision.refusal is not None and (self.reachable[0] or not self.commander.follow):
            then = "tried again when the present motion has ended" if decision.retry else "the last one stays"
            self.warning(f"target {format_degrees(target)} refused at t = {t:.6g} s: {decision.refusal}; {then}")
        self._decide(decision, target)
        self.discard_rows()
        return decision.retry

    def rows(self, t: float, h: float, n: int) -> Generator[int, None, NDArray[np.float64]]:
        """Commands of n steps, in parts."""
        yield -(-n // PART)  # the step at the end of the last table does nothing else
        if self.profile.remaining(t) <= 0.0:
            return self._find_rest(t, h, n)
        table = np.empty((n, self.y.size))
        for first in range(0, n, PART):
            part, begin = table[first : first + PART], t + first * h
            moving = self.profile.remaining(begin) > 0.0
            size = len(part)
            part[:] = self._outputs(self.times(begin, h, size)) if moving else self._find_rest(begin, h, size)
            yield (n - first - 1) // PART
        return table

    def _find_rest(self, t: float, h: float, n: int) -> NDArray[np.float64]:
        """Rows behind the end of the profile, where all are the same."""
        if len(self.at_rest) < n:
            self.at_rest = np.repeat(self._outputs(self.times(t, h, 1)), max(n, self.block_rows), axis=0)
        return self.at_rest[:n]

    def restore(self) -> None:
        """Rebuild the motion that the restored memory stands for."""
        self._build()
        self._follow(from_numbers(self.kept_profile))

    @refuse_parameters
    def _build(self) -> None:
        values = self.parameters()
        self.commander = take_values(DEFAULT, values)
        self.resolution = check_number(values["command_resolution"], "command_resolution", at_least=0.0)
        try:
            self.commander.pose(np.zeros(3))
        except KinematicsError as error:
            raise ModelError(f"algorithm_1.mu: {error}") from None
        self.kept_profile, rest = self.memory[:N_PROFILE], self.memory[N_PROFILE:]
        self.reachable, self.waiting, self.last_target = rest[:1], rest[1:2], rest[2:]

    def _follow(self, profile: Profile) -> None:
        self.profile = profile
        self.at_rest = np.empty((0, self.y.size))

    def _decide(self, decision: Decision, target: NDArray[np.float64]) -> None:
        self._follow(decision.profile)
        self.kept_profile[:] = to_numbers(decision.profile)
        self.reachable[0] = decision.refusal is None
        self.waiting[0] = decision.retry
        self.last_target[:] = target

    def _outputs(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        table = self.commander.table(self.profile, times)
        if self.resolution:
            table[:, :3] = np.rint(table[:, :3] / self.resolution) * self.resolution
        reachable = np.full(len(times), self.reachable[0])
        return np.column_stack([table, reachable, table[:, -1] > 0.0])


def format_degrees(orientation: NDArray[np.float64]) -> str:
    """An orientation for messages."""
    return f"({', '.join(f'{angle:.6g}' for angle in np.degrees(orientation))}) deg"
