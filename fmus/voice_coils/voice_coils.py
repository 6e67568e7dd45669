"""VoiceCoils: from the forces that controllers demand to those that act on the fine legs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ps_fmu.actuators.stops import FEWEST_STEPS, STEPS_AHEAD
from ps_fmu.actuators.voice_coil import Coils, WhiteNoise, discretise, sample_deviation
from ps_fmu.interface.ports import make_parameter_ports, refuse_parameters
from ps_fmu.mechanism.parameters import load
from ps_fmu.mechanism.quantities import take_values
from ps_fmu.slavekit.author.ahead import RowParts
from ps_fmu.slavekit.author.elements import Clip, Count, Element, Excess, Linear, Product, Quantise, Sine, Watch
from ps_fmu.slavekit.author.slave import ModelError, Slave
from ps_fmu.slavekit.author.variables import Port, numbered

DEFAULT = Coils.from_parameters(load())
N = 3  # coils
EYE, ZERO = np.eye(N), np.zeros((N, N))
INPUT: dict[str, Any] = {"causality": "input"}
# At rest, without current: no output depends on anything in initialisation mode.
OUTPUT: dict[str, Any] = {"causality": "output", "initially_depends_on": ()}


class VoiceCoils(Slave):
    """Three equal voice coils with digital current drivers, and the stops of the fine legs."""

    model_description = "Voice coils: current loops, limits, back-EMF, ripple and noise, and the stops of the fine legs"
    physics: ClassVar[type] = Coils
    n_states: ClassVar[int] = N  # currents, A
    n_row: ClassVar[int] = N  # noise of the demanded currents, of unit variance
    block_rows: ClassVar[int] = 4096
    n_memory: ClassVar[int] = 1 + 8 * N + 6 * N + 2 * N  # the constant 1; see _build; what contacts are counted with

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
        self.memory[0] = 1.0
        self._build()

    @refuse_parameters
    def restore(self) -> None:
        """Rebuild what the parameters stand for."""
        self._build()

    def step_map(self, h: float) -> NDArray[np.float64]:
        """The currents stay and the outputs become zero; the elements after the map do the rest."""
        self._warn_of_stops(h)
        return np.vstack([np.zeros((self.y.size, N)), EYE])

    def rows(self, t: float, h: float, n: int) -> RowParts:
        """Noise of unit variance in the steps that end at t + h ... t + n h (s), shape (n, 3), in parts."""
        yield n // 200  # the step at the end of the last table does nothing else
        if not self.coils.driver.noise:
            return np.zeros((n, N))
        return (yield from self.noise.in_parts(round((t + h - self.start_time) / h), n))

    def before_map(self, h: float) -> Sequence[Element]:
        """A contact that lasts too few steps is an event, which refuses it."""
        stop = self.coils.stop
        if h <= stop.find_largest_step():
            return ()
        return (Watch(self.view("fine_displacement"), self.zeros, stop.distance),)

    def event(self, t: float, h: float) -> bool:
        """Refuse a contact for which the step is too long."""
        stop, displacement = self.coils.stop, self.view("fine_displacement")
        if h > stop.find_largest_step() and np.abs(displacement).max() > stop.distance:
            leg = int(np.abs(displacement).argmax())
            raise ModelError(
                f"fine_displacement_{leg + 1} = {displacement[leg]:.6g} m is beyond the stop at {stop.distance:g} m, "
                f"and steps of {h:g} s make contacts unstable; expected steps of at most "
                f"{stop.find_largest_step():.3g} s, or a smaller stop.stiffness or stop.damping"
            )
        return False

    def after_map(self, h: float) -> Sequence[Element]:
        """Demand, driver, coil and stops; the equations are those of :mod:`ps_fmu.actuators.voice_coil`."""
        return [*self._make_demand(h), *self._make_circuit(h), *self._make_stops()]

    def _make_demand(self, h: float) -> Iterator[Element]:
        """What is linear in the inputs, and the demanded current: quantised, with noise, limited."""
        driver, stop, demand = self.coils.driver, self.coils.stop, self.demand
        ampere, damping = EYE / self.coils.coil.force_constant, stop.damping * EYE
        blocks = [
            [ampere, ampere, ZERO, ZERO],
            [ZERO, ZERO, EYE, STEPS_AHEAD * h * EYE],
            [ZERO, ZERO, ZERO, damping],
            [ZERO, ZERO, ZERO, -damping],
        ]
        yield Linear(self.u, np.block(blocks), self._join(demand, self.ahead, self.rate))
        if driver.current_resolution:
            yield Quantise(demand, driver.current_resolution)
        if driver.noise:
            yield Linear(self._join(demand, self.r), np.hstack([EYE, sample_deviation(driver.noise, h) * EYE]), demand)
        if driver.current_limit:
            yield Clip(demand, -driver.current_limit, driver.current_limit, "saturated")

    def _make_circuit(self, h: float) -> Iterator[Element]:
        """Force constant at this place, voltage within the supply's, current, force and heat."""
        coil, driver = self.coils.coil, self.coils.driver
        loop = discretise(coil, driver, h)
        displacement, current, voltage = self.view("fine_displacement"), self.view("current"), self.view("voltage")
        terms, factors = [self.one], [np.full((N, 1), coil.force_constant)]
        if coil.stroke_loss:
            yield Product(displacement, displacement, self.square)
            terms.append(self.square)
            factors.append(-coil.force_constant * coil.stroke_loss / coil.half_stroke**2 * EYE)
        if coil.ripple:
            yield Sine(displacement, coil.ripple_factor, coil.ripple_phase, self.sine)
            terms.append(self.sine)
            factors.append(coil.force_constant * coil.ripple * EYE)
        yield Linear(self._join(*terms), np.hstack(factors), self.constant)
        yield Product(self.constant, self.view("fine_velocity"), self.emf)
        feedback = [(coil.resistance - loop.gain) * EYE, loop.gain * EYE, driver.emf_compensation * EYE]
        yield Linear(self._join(self.x, self.demand, self.emf), np.hstack(feedback), voltage)
        if driver.supply_voltage:
            yield Clip(voltage, -driver.supply_voltage, driver.supply_voltage, "saturated")
        circuit = np.hstack([loop.decay * EYE, loop.response * EYE, -loop.response * EYE])
        yield Linear(
            self._join(self.x, voltage, self.emf),
            np.vstack([circuit, circuit, coil.resistance * circuit]),
            self._join(self.x, current, self.ohmic),
        )
        yield Product(self.constant, current, self.view("fine_force"))
        yield Product(self.ohmic, current, self.view("power"))

    def _make_stops(self) -> Iterator[Element]:
        """Forces of the stops, never pulling, and the contacts; nothing without stops."""
        stop = self.coils.stop
        if not stop.active:
            return
        force, part = self.view("fine_force"), self.view("stop_force")
        above, below = np.full(N, stop.distance), np.full(N, np.inf)
        ahead = self.places(self.ahead)
        yield Excess(np.concatenate([ahead, ahead]), -np.hstack([below, above]), np.hstack([above, below]), self.excess)
        yield Clip(self.rate, -1.0, np.inf)
        yield Product(self.excess, self.rate, self.grown)
        push = np.tile(-stop.stiffness * EYE, 4)
        yield Linear(
            self._join(force, self.excess, self.grown),
            np.vstack([np.hstack([EYE, push]), np.hstack([ZERO, push])]),
            self._join(force, part),
        )
        yield Count(part, 0.0, self.counted, self.view("contacts"))
        yield Clip(self.ahead, -stop.distance, stop.distance, "contact")

    def _build(self) -> None:
        self.coils = take_values(DEFAULT, self.parameters())
        self.noise = WhiteNoise(self.coils.driver.seed, N)
        sizes = (1, N, N, N, N, N, N, N, N, 2 * N, 2 * N, 2 * N)
        (
            self.one, self.zeros, self.demand, self.constant, self.square, self.sine, self.emf, self.ohmic, self.ahead,
            self.rate, self.excess, self.grown, self.counted,
        ) = np.split(self.memory, np.cumsum(sizes))  # fmt: skip

    def _join(self, *views: NDArray[np.float64]) -> NDArray[np.int64]:
        """The places of several views, one after the other."""
        return np.concatenate([self.places(view) for view in views])

    def _warn_of_stops(self, h: float) -> None:
        """Warn of steps that are long for a contact."""
        stop = self.coils.stop
        steps, longest = stop.count_contact_steps(h), stop.find_largest_step()
        if h > longest:
            self.warning(
                f"stop.stiffness, stop.damping: contacts with the stops are unstable at steps of {h:g} s and will be "
                f"refused; expected steps of at most {longest:.3g} s"
            )
        elif steps < FEWEST_STEPS:
            self.warning(
                f"stop.stiffness: a contact with a stop lasts {steps:.1f} steps of {h:g} s; expected {FEWEST_STEPS} or "
                f"more. The leg needs a damping of {stop.find_needed_damping(h):.3g} N.s/m"
            )
