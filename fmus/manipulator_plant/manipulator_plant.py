"""ManipulatorPlant: payload, six legs and flexible bus, linearised about the pose of the coarse legs."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.ports import make_output_ports, make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.linear_model import N_INPUTS, N_LOADS, OUTPUTS, Plant, PlantModel
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.mechanism.slews import N_CONVECTION, Convection, coarse_motion
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

DEFAULT = Plant.from_parameters(load())
INPUT: dict[str, Any] = {"causality": "input"}


class ManipulatorPlant(Slave):
    """Six-leg dynamics with payload truss modes, coarse-rod flexibility and bus modes."""

    model_description = "Pointing and stabilising manipulator with payload on a free flexible bus: linearised dynamics"
    n_states: ClassVar[int] = DEFAULT.n_states
    n_auxiliary: ClassVar[int] = N_INPUTS - N_LOADS  # inputs of the model that a slew makes, and its constant 1
    n_memory: ClassVar[int] = 3 + N_CONVECTION  # coarse displacement at the pose of the linear model (3, m), convection

    ports: ClassVar[tuple[Port, ...]] = (
        # Nominal values: magnitudes under the default disturbance, and in a slew.
        *numbered("fine_force", 3, "N", "Force of a fine actuator, positive extends the leg", nominal=0.1, **INPUT),
        *vector(
            "base_force", "xyz", "N", "Disturbance force on the bus at the origin of B, in B", nominal=10.0, **INPUT
        ),
        *vector(
            "base_torque", "xyz", "N.m", "Disturbance torque on the bus about the origin of B, in B",
            nominal=10.0, **INPUT,
        ),
        *numbered(
            "coarse_command", 3, "m", "Commanded displacement of a coarse actuator from its nominal length",
            event=True, display_unit="mm", nominal=0.01, **INPUT,
        ),
        *make_output_ports(OUTPUTS),
        *make_parameter_ports(DEFAULT),
        Port(
            "relinearisation_distance", "parameter", "m", start=2e-5, min=1e-9, display_unit="um",
            description="A new linear model is made when a coarse leg is this far from the pose of the last one",
        ),
    )  # fmt: skip

    terminals: ClassVar[tuple[Terminal, ...]] = (
        Terminal("fine_actuators", ("fine_force",), "Forces of the fine actuators"),
        Terminal("coarse_actuators", ("coarse_command",), "Commands of the coarse actuators"),
        Terminal("base_disturbance", ("base_force", "base_torque"), "Wrench that shakes the bus, at the origin of B"),
        Terminal(
            "measurements",
            ("base_acceleration", "base_angular_acceleration", "orientation"),
            "Accelerometers at the origin of B, and the nominal orientation of P",
        ),
    )

    plant: Plant
    model: PlantModel
    warned_command: tuple[float, ...] = ()  # the command beyond the stroke that the last warning was about

    @refuse_parameters
    def configure(self) -> None:
        """Build the system from the parameters and put it at rest at the commanded pose."""
        self._build()
        self._linearise(self._command())
        self.x[:] = self.plant.initial_state(self.model)
        self.a[:-1], self.a[-1] = 0.0, 1.0
        self.convection[:] = 0.0

    def output_map(self) -> NDArray[np.float64]:
        """Outputs from [x; u; a] at the same instant."""
        return self.model.output_map()

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        return self.model.step_map(h)

    @refuse_parameters
    def event(self, t: float, h: float) -> bool:
        """The coarse legs move: advance their reference, linearise anew where needed."""
        convection = Convection.read(self.convection)
        motion = coarse_motion(self.plant, self.model, self.x, convection, self._command(), h, self.resolution)
        if motion.model is not self.model:
            self.model = motion.model
            self.pose[:] = self.model.coarse_reference
            self.remap()
        motion.convection.write(self.convection)
        self.x[:] = motion.state
        self.a[:3], self.a[3:9] = motion.rate, motion.wrench
        return motion.moving

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild the model that the restored memory stands for."""
        self._build()
        self._linearise(self.pose.copy())
        self.remap()

    def _build(self) -> None:
        values = self.parameters()
        self.plant = take_values(DEFAULT, values)
        self.resolution = float(values["relinearisation_distance"])
        self.command = self.view("coarse_command")
        self.pose, self.convection = self.memory[:3], self.memory[3:]

    def _linearise(self, coarse_displacement: NDArray[np.float64]) -> None:
        self.model = self.plant.linearise(coarse_displacement)
        self.pose[:] = coarse_displacement

    def _command(self) -> NDArray[np.float64]:
        """The command within the stroke; a command beyond it is warned of once."""
        within = self.plant.within_stroke(self.command)
        if within.tolist() != self.command.tolist() and tuple(self.command) != self.warned_command:
            self.warned_command = tuple(self.command)
            worst = int(np.argmax(np.abs(within - self.command)))
            self.warning(
                f"coarse_command_{worst + 1}: {self.command[worst]:.6g} m is outside the stroke "
                f"{self.plant.manipulator.coarse_stroke.tolist()} m; held at its end"
            )
        return within
