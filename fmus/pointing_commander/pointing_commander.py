"""PointingCommander: smooth motion to a target orientation with the fine actuators at rest."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from ps_fmu.control.commander import N_MEMORY, Commander, CommanderWords
from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.inverse_kinematics import inverse_kinematics, why_unreachable
from ps_fmu.mechanism.kinematics import KinematicsError
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import check_number, take_values
from ps_fmu.numerics.library import find_function, find_library
from ps_fmu.slavekit.author.elements import Call, Element
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Commander.from_parameters(load())
RPY = ("roll", "pitch", "yaw")
DEG: dict[str, Any] = {"display_unit": "deg", "nominal": 0.1}
DEG_PER_S: dict[str, Any] = {"display_unit": "deg/s", "nominal": 0.01}
MM: dict[str, Any] = {"display_unit": "mm", "nominal": 0.01}
OUTPUT: dict[str, Any] = {"causality": "output"}
# The motion begins at rest, wherever the first target is.
AT_REST: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}


class PointingCommander(Slave):
    """Turns the payload platform to a target orientation; refuses what the mechanism cannot reach."""

    model_description = "Pointing commander: coarse actuator commands for a target orientation of P in B"
    physics: ClassVar[type] = Commander
    n_memory: ClassVar[int] = N_MEMORY
    any_step: ClassVar[bool] = True

    ports: ClassVar[tuple[Port, ...]] = (
        *vector("target", RPY, "rad", "Target orientation of P in B", causality="input", **DEG),
        # The order of Outputs in commander.c.
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

    @refuse_parameters
    def configure(self) -> None:
        """Rest at the initial target."""
        words, library = self._build(), find_library()
        library.control_begin(ctypes.byref(words), ctypes.byref(self._core))
        self._pass_warning()

    def step_map(self, h: float) -> None:
        """Return None: C does all."""

    def before_map(self, h: float) -> Sequence[Element]:
        """Return what a step does: what becomes of the target, and the commands at its end."""
        written = np.concatenate([self.places(self.memory), self.places(self.y)])
        return (Call(find_function("control_command"), self._build(), written),)

    @refuse_parameters
    def restore(self) -> None:
        """Refuse what configure refuses: nothing is derived from the buffer."""
        self._build()

    def _build(self) -> CommanderWords:
        values = self.parameters()
        commander = take_values(DEFAULT, values)
        resolution = check_number(values["command_resolution"], "command_resolution", at_least=0.0)
        try:
            nominal = inverse_kinematics(commander.geometry, np.zeros(3), commander.method)
        except KinematicsError as error:
            raise ModelError(f"algorithm_1.mu: {error}") from None
        if not nominal.solved:
            raise ModelError(f"geometry: no nominal pose: {why_unreachable(commander.geometry, nominal)}")
        target, memory, outputs = (int(self.places(view)[0]) for view in (self.view("target"), self.memory, self.y))
        return commander.pack(resolution, target=target, memory=memory, outputs=outputs)
