"""ManipulatorPlant: payload, six legs and flexible bus, in any motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np

from ps_fmu.interface.ports import make_output_ports, make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.compiled import N_MOVING_INPUTS
from ps_fmu.mechanism.initial_motion import STILL
from ps_fmu.mechanism.linear_model import Plant
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import Array, ParameterError, take_values
from ps_fmu.mechanism.signals import LOCKED, OUTPUTS, REACTION, count_states, servo_slices
from ps_fmu.mechanism.stepping import N_MEMORY, RENEWAL, Memory, PlantStep, find_step
from ps_fmu.slavekit.author.elements import Call, Element
from ps_fmu.slavekit.author.model import Matrices
from ps_fmu.slavekit.author.slave import Slave
from ps_fmu.slavekit.author.terminals import Terminal
from ps_fmu.slavekit.author.variables import Port, numbered, vector

N_LOADED = 18  # inputs that act as forces
DEFAULT = Plant.from_parameters(load())
INPUT: dict[str, Any] = {"causality": "input"}
MOTION: dict[str, Any] = {"causality": "input", "nominal": 1e-3}
WITHOUT_HOST = ("prescribed_acceleration", "prescribed_angular_acceleration", "prescribed_angular_velocity")
WITH_HOST = ("base_force", "base_torque")


class ManipulatorPlant(Slave):
    """Six-leg dynamics with payload truss modes, coarse-rod flexibility and bus modes."""

    model_description = "Pointing and stabilising manipulator with payload on a free flexible bus, in any motion"
    physics: ClassVar[type] = Plant
    n_states: ClassVar[int] = count_states(DEFAULT.most_coordinates)  # those of modes in unused places are zero
    n_memory: ClassVar[int] = N_MEMORY
    any_step: ClassVar[bool] = True
    provides_derivatives: ClassVar[bool] = True

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
            "added_fine_force", 3, "N", "Further force of a fine actuator, added to fine_force", nominal=0.1, **INPUT
        ),
        *vector(
            "payload_force", "xyz", "N", "Force on the payload at the origin of P, in P", nominal=0.1, **INPUT
        ),
        *vector(
            "payload_torque", "xyz", "N.m", "Torque on the payload about the origin of P, in P", nominal=0.1, **INPUT
        ),
        *vector(
            "prescribed_acceleration", "xyz", "m/s2",
            "With base = prescribed: acceleration of the origin of B, mean over the step, in B", **MOTION,
        ),
        *vector(
            "prescribed_angular_acceleration", "xyz", "rad/s2",
            "With base = prescribed: angular acceleration of B, mean over the step, in B", **MOTION,
        ),
        *vector(
            "prescribed_angular_velocity", "xyz", "rad/s",
            "With base = prescribed: angular velocity of B, mean over the step, in B", **MOTION,
        ),
        *numbered(
            "coarse_command", 3, "m", "Commanded displacement of a coarse actuator from its nominal length",
            display_unit="mm", nominal=0.01, **INPUT,
        ),
        *make_output_ports(OUTPUTS + REACTION),
        Port(
            "locked_mass", "output", "kg", "Mass of legs and payload, which a host adds to its hub", nominal=10.0,
        ),
        *make_output_ports(LOCKED),
        *make_parameter_ports(DEFAULT),
        *make_parameter_ports(STILL),
        Port(
            "base", "parameter", type="String", start="own",
            description="own: the FMU contains the bus; prescribed: inputs prescribed_... give the motion of the base",
        ),
        *make_parameter_ports(RENEWAL),
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
        Terminal(
            "attitude",
            ("payload_attitude", "line_of_sight", "payload_rotation.x", "payload_rotation.y"),
            "Where the payload looks",
        ),
    )

    plant: Plant
    step: PlantStep
    elements: list[Element]
    prescribed: bool
    warned_unused: tuple[str, ...] = ()  # what the last warning was about that something has no effect

    @refuse_parameters
    def configure(self) -> None:
        """Build the mechanism from the parameters and put it at the commanded pose, undeformed."""
        command = self._build(self.view("coarse_command"))
        initial = take_values(STILL, self.parameters())
        n = self.step.mechanism.n
        s, _, r = servo_slices(n)
        self.x[:] = 0.0
        self.x[s] = self.x[r] = command
        self.x[n + 6 : n + 9] = (
            self.view("prescribed_angular_velocity") if self.prescribed else initial.initial_angular_velocity_B
        )
        Memory.from_address(self.memory.ctypes.data).place.attitude[:] = initial.unit_attitude
        self.step.begin(self._core)
        self._warn_of_unused()

    def before_map(self, h: float) -> Sequence[Element]:
        """The step, of any size: all or nothing by itself."""
        return self.elements

    def step_map(self, h: float) -> None:
        """There is none."""

    def linearise(self) -> tuple[Matrices, Array]:
        """About the present motion, exactly; the coarse command is no input, since references limit its rate.

        Nor is a prescribed angular velocity, which is a state.  Mass, inertia and centre of mass of legs and payload,
        which a host adds to its own, have no derivatives.
        """
        mechanism, n = self.step.mechanism, self.step.mechanism.n_states
        x, u, base = self.x[:n], np.zeros(N_MOVING_INPUTS), slice(N_MOVING_INPUTS - 6, N_MOVING_INPUTS)
        u[:N_LOADED], u[base] = self.u[:N_LOADED], self.u[N_LOADED : N_LOADED + 6] * self.prescribed
        point = mechanism.evaluate(Memory.from_address(self.memory.ctypes.data).place, x, u)
        A, B, C, D, E, F = mechanism.linearise(point)
        rates = point.read("rates", n)
        if self.prescribed:  # what moves the base is given
            given = np.r_[3:6, mechanism.n + 3 : mechanism.n + 9]
            A[given], B[given], rates[given] = 0.0, 0.0, 0.0
        all_A, all_B = np.zeros((self.n_states, self.n_states)), np.zeros((self.n_states, self.u.size))
        all_C, all_D = (np.full((self.y.size, columns), np.nan) for columns in (self.n_states, self.u.size))
        rows = np.vstack([C, E]), np.vstack([D, F])
        all_A[:n, :n], all_C[: len(rows[0])] = A, 0.0
        all_C[: len(rows[0]), :n] = rows[0]
        for into, whole in ((all_B[:n], B), (all_D[: len(rows[1])], rows[1])):
            into[:, :N_LOADED] = whole[:, :N_LOADED]
            into[:, N_LOADED : N_LOADED + 6] = whole[:, base] * self.prescribed
            into[:, N_LOADED + 6 : N_LOADED + 9] = np.nan if self.prescribed else 0.0
            into[:, N_LOADED + 9 :] = np.nan
        return (all_A, all_B, all_C, all_D), np.concatenate([rates, np.zeros(self.n_states - n)])

    def restore(self) -> None:
        """Make the mechanism again; what it makes itself follows from states and memory."""
        self._build(np.array(Memory.from_address(self.memory.ctypes.data).start))

    def _build(self, start: Array) -> Array:
        """``start`` (3,), m: where the coarse legs are at the start of the run, which is returned within the stroke."""
        values = self.parameters()
        self.plant = take_values(DEFAULT, values)
        self.prescribed = _read_base(str(values["base"]))
        places = tuple(part.start for part in (self.layout.x, self.layout.u, self.layout.y, self.layout.memory))
        renewal = take_values(RENEWAL, values)
        command = self.plant.within_stroke(start)
        try:
            self.step = PlantStep(self.plant, renewal, command, places, prescribed=self.prescribed)
        except ArithmeticError as error:
            at = ", ".join(f"{1e3 * displacement:.4g}" for displacement in command)
            raise ParameterError(
                "coarse_stroke", f"too large: no usable pose with the coarse legs at ({at}) mm from nominal; {error}"
            ) from error
        self.elements = [Call(find_step(), self.step.words, kept=self.step)]
        self.remap()
        return command

    def _warn_of_unused(self) -> None:
        """Name what is set and has no effect, each time that it is something else."""
        unused = [name for name in (WITH_HOST if self.prescribed else WITHOUT_HOST) if self.view(name).any()]
        if self.prescribed:
            unused += [f"bus.mode_{i}.frequency" for i, mode in enumerate(self.plant.bus.modes, 1) if mode.active]
        if unused and tuple(unused) != self.warned_unused:
            base = "prescribed" if self.prescribed else "own"
            self.warning(f"base = {base}: no effect of {', '.join(unused)}")
        self.warned_unused = tuple(unused)


def _read_base(base: str) -> bool:
    if base not in ("own", "prescribed"):
        raise ParameterError("base", f"expected own or prescribed, got {base!r}")
    return base == "prescribed"
