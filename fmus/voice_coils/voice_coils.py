"""VoiceCoils: from the forces that controllers demand to those that act on the fine legs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.actuators.voice_coil import Coils
from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.numerics.library import find_arithmetic
from ps_fmu.slavekit.author.elements import Call, Element
from ps_fmu.slavekit.author.model import Matrices
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.variables import Port, numbered

DEFAULT = Coils.from_parameters(load())
N = 3  # coils
INPUT: dict[str, Any] = {"causality": "input"}
# At rest, without current: no output depends on anything in initialisation mode.
OUTPUT: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}


class VoiceCoils(Slave):
    """Three equal voice coils with digital current drivers, and the stops of the fine legs."""

    model_description = "Voice coils: current loops, limits, back-EMF, ripple and noise, and the stops of the fine legs"
    physics: ClassVar[type] = Coils
    n_states: ClassVar[int] = N  # currents, A
    any_step: ClassVar[bool] = True
    provides_derivatives: ClassVar[bool] = True
    n_memory: ClassVar[int] = 1 + 2 * N  # start time, s; what contacts are counted with

    ports: ClassVar[tuple[Port, ...]] = (
        *numbered(
            "force_command", N, "N", "Force demanded of a coil, positive extends the leg", nominal=0.1, **INPUT
        ),
        *numbered("added_force_command", N, "N", "Second demand, added to force_command", nominal=0.1, **INPUT),
        *numbered(
            "fine_displacement", N, "m", "Elongation of a fine leg", display_unit="um", nominal=1e-6, **INPUT
        ),
        *numbered("fine_velocity", N, "m/s", "Rate of the elongation of a fine leg", nominal=1e-5, **INPUT),
        *numbered("fine_force", N, "N", "Force of coil and stop on a leg, positive extends it", nominal=0.1, **OUTPUT),
        *numbered("current", N, "A", "Current of a coil", nominal=0.1, **OUTPUT),
        *numbered("voltage", N, "V", "Voltage at a coil during the step", nominal=0.1, **OUTPUT),
        *numbered("power", N, "W", "Heat of a coil, resistance times current squared", nominal=1e-3, **OUTPUT),
        *numbered("stop_force", N, "N", "Part of fine_force that comes from the stops", nominal=1.0, **OUTPUT),
        Port("contacts", unit="1", description="Number of contacts with stops since the start", nominal=1.0, **OUTPUT),
        Port("saturated", type="Boolean", description="True: a current or a voltage is at its limit", **OUTPUT),
        Port("contact", type="Boolean", description="True: a leg is at a stop", **OUTPUT),
        *make_parameter_ports(DEFAULT),
    )  # fmt: skip

    @refuse_parameters
    def configure(self) -> None:
        """Build coils, drivers and stops; no current, no contact."""
        self.y[:] = self.x[:] = self.memory[:] = 0.0
        self.memory[0] = self.start_time
        self._build()

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the parameters stand for."""
        self._build()

    def step_map(self, h: float) -> None:
        """None: an element does all."""

    def before_map(self, h: float) -> Sequence[Element]:
        """Demand, driver, coil and stops; the equations are those of :mod:`ps_fmu.actuators.voice_coil`."""
        arguments, layout, memory = self.coils.describe(), self.layout, self.layout.memory.start
        arguments.outputs, arguments.currents, arguments.inputs = layout.y.start, layout.x.start, layout.u.start
        arguments.start, arguments.counted = memory, memory + 1
        target = np.concatenate([self.places(view) for view in (self.y, self.x, self.memory[1:])])
        return (Call(find_arithmetic().step_coils, arguments, target, arguments.kept),)

    def linearise(self) -> tuple[Matrices, NDArray[np.float64]]:
        """About the present displacements, within all limits; voltages depend on the size of the step."""
        coil, driver, stop = self.coils.coil, self.coils.driver, self.coils.stop
        displacement, eye = self.view("fine_displacement"), np.eye(N)
        if stop.active and np.abs(displacement).max() > stop.distance:
            leg = int(np.abs(displacement).argmax()) + 1
            raise ModelError(f"fine_displacement_{leg}: expected a leg between its stops at {stop.distance:g} m")
        constant = coil.compute_constant(displacement)
        rate, back = 2.0 * np.pi * driver.bandwidth, (driver.emf_compensation - 1.0) / coil.inductance
        velocity, current, change = self.view("fine_velocity"), self.x, coil.differentiate_constant(displacement)
        A, demand = -rate * eye, rate / coil.force_constant * eye
        B = np.hstack([demand, demand, np.diag(back * change * velocity), np.diag(back * constant)])
        C, D = np.zeros((self.y.size, N)), np.zeros((self.y.size, self.u.size))
        C[:N], C[N : 2 * N], C[3 * N : 4 * N] = np.diag(constant), eye, np.diag(2.0 * coil.resistance * current)
        D[:N, 2 * N : 3 * N] = np.diag(change * current)
        C[2 * N : 3 * N] = D[2 * N : 3 * N] = np.nan
        force = self.u[:N] + self.u[N : 2 * N]
        return (A, B, C, D), rate * (force / coil.force_constant - current) + back * constant * velocity

    def _build(self) -> None:
        self.coils = take_values(DEFAULT, self.parameters())
