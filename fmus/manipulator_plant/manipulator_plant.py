"""ManipulatorPlant: payload, six legs and flexible bus, linearised about the pose of the coarse legs."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.interface.parameter_ports import parameter_ports, refuses_parameters
from ps_fmu.mechanism.linear_model import PlantModel
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import list_entries, take_values
from ps_fmu.mechanism.slews import Convection, Plant, coarse_motion
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

PAPER = load()
RPY = ("roll", "pitch", "yaw")
INPUT: dict[str, Any] = {"causality": "input"}
OUTPUT: dict[str, Any] = {"causality": "output"}
POSE: dict[str, Any] = {"causality": "output", "display_unit": "deg", "nominal": 0.1}
# Everything starts at rest and undeformed: these depend on nothing in initialisation mode.
AT_REST: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}
MICROMETRES: dict[str, Any] = AT_REST | {"display_unit": "um"}
MICRORADIANS: dict[str, Any] = AT_REST | {"display_unit": "urad"}


class ManipulatorPlant(Slave):
    """Six-leg dynamics with payload truss modes, coarse-rod flexibility and bus modes."""

    model_description = "Pointing and stabilising manipulator with payload on a free flexible bus: linearised dynamics"
    # The state x of practical.PlantModel: coordinates and rates, then the coarse servos.
    n_states: ClassVar[int] = 2 * (3 + 6 + len(PAPER.bus.modes) + 3 + len(PAPER.payload.truss_modes)) + 9
    n_auxiliary: ClassVar[int] = 10  # rate of the coarse reference (3, m/s), convective wrench (6), constant 1
    n_memory: ClassVar[int] = 11  # coarse displacement at the pose of the linear model (3, m); plant.Convection (8)

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
        # Outputs: the order of practical.OUTPUTS.
        *vector("base_acceleration", "xyz", "m/s2", "Acceleration of the origin of B, in B", nominal=1e-3, **OUTPUT),
        *vector(
            "base_angular_acceleration", "xyz", "rad/s2", "Angular acceleration of B, in B", nominal=1e-3, **OUTPUT
        ),
        *vector("base_velocity", "xyz", "m/s", "Velocity of the origin of B, in B", nominal=1e-5, **AT_REST),
        *vector("base_angular_velocity", "xyz", "rad/s", "Angular velocity of B, in B", nominal=1e-5, **AT_REST),
        *vector(
            "base_position", "xyz", "m", "Displacement of the origin of B since the start, in B",
            nominal=1e-5, **MICROMETRES,
        ),
        *vector(
            "base_rotation", "xyz", "rad", "Small rotation of B since the start, in B", nominal=1e-5, **MICRORADIANS
        ),
        *vector(
            "payload_position", "xyz", "m", "Displacement of the origin of P by vibration, in B",
            nominal=1e-5, **MICROMETRES,
        ),
        *vector(
            "payload_rotation", "xyz", "rad", "Small rotation of P by vibration (jitter), in P",
            nominal=1e-6, **MICRORADIANS,
        ),
        *numbered("fine_displacement", 3, "m", "Elongation of a fine leg", nominal=1e-6, **MICROMETRES),
        *numbered(
            "coarse_displacement", 3, "m", "Displacement of a coarse actuator from its nominal length",
            display_unit="mm", nominal=0.01, **OUTPUT,
        ),
        *vector("orientation", RPY, "rad", "Nominal orientation of P in B, by the coarse actuators alone", **POSE),
        *vector("relative_orientation", RPY, "rad", "Orientation of P in B with fine legs and rod stretch", **POSE),
        *vector(
            "los", "xy", "m", "Image point of the boresight on the image plane, axes of P", nominal=1e-6, **MICROMETRES
        ),
        *parameter_ports(
            list_entries(PAPER.manipulator)
            + list_entries(PAPER.payload, "payload")
            + list_entries(PAPER.bus, "bus")
            + list_entries(PAPER.servo, "servo")
            + list_entries(PAPER.optics, "optics")
        ),
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
    said_of: tuple[float, ...] = ()  # the command beyond the stroke that the last warning was about

    @refuses_parameters
    def configure(self) -> None:
        """Build the system from the parameters and put it at rest at the commanded pose."""
        self._build()
        command = self._command()
        self._use(command)
        self.x[:] = self.plant.initial_state(self.model)
        self.a[:-1], self.a[-1] = 0.0, 1.0
        self.memory[3:] = 0.0

    def output_map(self) -> NDArray[np.float64]:
        """Outputs from [x; u; a] at the same instant."""
        return self.model.output_map()

    def step_map(self, h: float) -> NDArray[np.float64]:
        """[y; x] at the end of a step from [x; u; a] at its start."""
        return self.model.step_map(h)

    @refuses_parameters
    def event(self, t: float, h: float) -> bool:
        """The coarse legs move: advance their reference, linearise anew where needed."""
        convection = Convection(self.memory[3:9], *self.memory[9:11].tolist())
        motion = coarse_motion(self.plant, self.model, self.x, convection, self._command(), h, self.resolution)
        if motion.model is not self.model:
            self.model = motion.model
            self.memory[:3] = self.model.coarse_reference
            self.remap()
        self.memory[3:9], self.memory[9], self.memory[10] = motion.convection
        self.x[:] = motion.state
        self.a[:3], self.a[3:9] = motion.rate, motion.wrench
        return motion.moving

    @refuses_parameters
    def restore(self) -> None:
        """Rebuild the model that the restored memory stands for."""
        self._build()
        self._use(self.memory[:3].copy())
        self.remap()

    def _build(self) -> None:
        values = self.parameters()
        self.plant = Plant(
            take_values(PAPER.manipulator, values),
            take_values(PAPER.payload, values, "payload"),
            take_values(PAPER.bus, values, "bus"),
            take_values(PAPER.servo, values, "servo"),
            take_values(PAPER.optics, values, "optics"),
        )
        self.command = self.view("coarse_command")
        self.resolution = float(values["relinearisation_distance"])

    def _use(self, coarse_displacement: NDArray[np.float64]) -> None:
        self.model = self.plant.linearise(coarse_displacement)
        self.memory[:3] = coarse_displacement

    def _command(self) -> NDArray[np.float64]:
        held = self.plant.within_stroke(self.command)
        if held.tolist() != self.command.tolist() and tuple(self.command) != self.said_of:
            self.said_of = tuple(self.command)
            worst = int(np.argmax(np.abs(held - self.command)))
            self.warning(
                f"coarse_command_{worst + 1}: {self.command[worst]:.6g} m is outside the stroke "
                f"{self.plant.manipulator.coarse_stroke.tolist()} m; held at its end"
            )
        return held
