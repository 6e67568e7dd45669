"""Stability of the internal loop: base acceleration - isolator - fine force - base, with a pure delay (section 3.2.2).

The isolator is called feedforward, but its force moves the base whose motion it measures.  With the fine forces
``f = K_we(s) s^2 q_b exp(-s tau)`` of (55) and the base motion ``q_b = C(s) f + D(s) w_b`` of (34)::

    L(s) = s^2 C(s) K_we(s) exp(-s tau)      loop transfer matrix, (6, 6)
    S(s) = (E - L(s))^-1                     sensitivity, eq (48)

The feedback is positive: the critical point of Nyquist's criterion is **+1**.  The paper reads the margins of +L
against -1 (:func:`element_margins`).  Zeros of det(E - L) are the poles of the loop; C (the practical plant, from force
to base acceleration) and K_we have all their poles in the left half-plane.

Plant and controller are python-control systems, too.  Their signals have the names of the FMU's ports with ``_`` for
the dot, which python-control does not allow in a name.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ..control.feedforward import Controller
from ..control.isolator import Isolator
from ..mechanism.inverse_kinematics import inverse_kinematics
from ..mechanism.linear_model import Plant, PlantModel
from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, Complex
from ..mechanism.signals import N_INPUTS, N_LOADS, OUTPUTS
from .stability import (
    UnstableError,
    count_poles,
    find_crossings,
    find_delay_margin,
    find_unstable,
    refine_pole,
    sort_poles,
)
from .transfer_matrices import Practical, place_frequencies

if TYPE_CHECKING:
    from control import StateSpace

_LOWEST, _HIGHEST = 1e-7, 1e5  # Hz: range of the Nyquist curve; beyond it L is below 1e-5
_PADE_ORDER = 12


@dataclass(frozen=True, eq=False)
class Loop:
    """The internal loop of the practical plant at one pose."""

    model: PlantModel
    controller: Controller
    delay: float = 0.0
    """Pure delay tau of the forces, s."""

    def with_delay(self, delay: float) -> Loop:
        """The same loop with another delay, s."""
        return replace(self, delay=delay)

    def inverted(self) -> Loop:
        """The loop with the force in the opposite direction: L with its sign changed, critical point -1."""
        g = self.controller.gains
        gains = replace(g, acceleration=-g.acceleration, velocity=-g.velocity, displacement=-g.displacement)
        return replace(self, controller=replace(self.controller, gains=gains))

    def transfer(self, s: ArrayLike) -> Complex:
        """L(s), (..., 6, 6), from base acceleration to the base acceleration that its force makes."""
        s = np.asarray(s, dtype=complex)
        return np.asarray(self._from_force(s) @ self.controller.response(s) * _delayed(s, self.delay))

    def eigenvalues(self, s: ArrayLike) -> Complex:
        """The three eigenvalues of L(s) that are not zero, (..., 3)."""
        s = np.asarray(s, dtype=complex)
        loop = self.controller.response(s) @ self._from_force(s)
        return np.asarray(np.linalg.eigvals(loop * _delayed(s, self.delay)))

    def characteristic(self, s: ArrayLike) -> Complex:
        """det(E - L(s)), (...); computed as det(E_3 - K s^2 C)."""
        return np.asarray(np.prod(1.0 - self.eigenvalues(s), axis=-1))

    def sensitivity(self, s: ArrayLike) -> Complex:
        """S(s) = (E - L)^-1 of eq (48), (..., 6, 6)."""
        return np.asarray(np.linalg.inv(np.eye(6) - self.transfer(s)))

    def _from_force(self, s: Complex) -> Complex:
        """s^2 C(s), (..., 6, 3): fine force to base acceleration."""
        return s[..., None, None] ** 2 * Practical(self.model.dynamics).C(s)

    # --- Poles --------------------------------------------------------------------------

    def unstable_poles(self) -> int:
        """Zeros of det(E - L) in the right half-plane, by the argument principle along the imaginary axis."""
        return count_poles(self.characteristic, self._frequencies)

    def require_stable(self) -> None:
        """Raise :class:`.stability.UnstableError`, with the poles, if the loop is unstable."""
        if len(self._unstable):
            raise UnstableError(f"plant and isolator with a delay of {self.delay:g} s", self._unstable)

    @cached_property
    def _unstable(self) -> Complex:
        return find_unstable(self.characteristic, self._frequencies)

    @cached_property
    def _frequencies(self) -> Array:
        return place_frequencies(self.plant_poles(), _LOWEST, _HIGHEST, 250, 8)

    def poles(self) -> Complex:
        """Poles of the closed loop within reach of a Pade approximation, refined with the exact delay, (n,), rad/s.

        Those to the right come first.  A loop with delay has infinitely many, ever further to the left.
        """
        if self.delay == 0.0:
            return sort_poles(np.linalg.eigvals(self._closed(0)).astype(complex))
        rough = np.linalg.eigvals(self._closed(_PADE_ORDER))
        # Not the free base at zero, which the loop does not move, nor where the approximation of the delay ends.
        usable = (np.abs(rough) > 1e-6) & (np.abs(rough) < _PADE_ORDER / self.delay) & (rough.imag >= 0.0)
        opened, near = self.open_poles(), []
        for start in rough[usable].tolist():
            pole = refine_pole(self.characteristic, start, opened=opened)
            if pole is not None and abs(pole - start) < 0.1 * abs(start):
                near.append(pole)
        found = np.array(near)
        return sort_poles(_distinct(np.concatenate([found, found[found.imag > 0.0].conj()])))

    def open_poles(self) -> Complex:
        """Poles of plant and controller, the loop cut open, rad/s."""
        return np.concatenate([self.plant_poles(), controller_system(self.controller).poles()])

    def plant_poles(self) -> Complex:
        """Poles of the plant alone, rad/s."""
        return np.asarray(np.linalg.eigvals(plant_system(self.model).A).astype(complex))

    def _closed(self, order: int) -> Array:
        """System matrix of plant, controller and Pade approximation of the delay."""
        from control import append, feedback, pade, ss, tf

        plant, isolator = plant_system(self.model), controller_system(self.controller)
        accelerations = plant[BASE_ACCELERATION, FINE_FORCES]
        if order:
            one = ss(tf(*pade(self.delay, order)))
            isolator = append(one, one, one) * isolator
        return np.asarray(feedback(accelerations, isolator, sign=1).A)

    # --- Limit of the delay -------------------------------------------------------------

    @cached_property
    def delay_limit(self) -> float:
        """Smallest delay at which a pole reaches the imaginary axis, s; infinite if none ever does.

        There an eigenvalue of L without delay has modulus one at some frequency w, and the delay turns it to +1:
        ``tau = arg(lambda) / w``.
        """
        bare = self.with_delay(0.0)

        def transfer(frequency: Array) -> Complex:
            s = np.asarray(2j * np.pi * frequency)
            return np.asarray(-bare.controller.response(s) @ bare._from_force(s))  # critical point -1

        return find_delay_margin(transfer, np.geomspace(1e-3, 1e4, 8_000))


def delay_limit_by_bisection(loop: Loop, longest: float, tolerance: float = 1e-6) -> float:
    """Delay at which the loop loses stability, s, by bisection of the number of unstable poles; inf beyond ``longest``.

    Independent of :attr:`Loop.delay_limit`.  Presumes one change of stability between zero and ``longest``.
    """
    if loop.with_delay(longest).unstable_poles() == 0:
        return np.inf
    low, high = 0.0, longest
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if loop.with_delay(middle).unstable_poles() == 0 else (low, middle)
    return 0.5 * (low + high)


def loop_at(parameters: Parameters, orientation: ArrayLike = (0.0, 0.0, 0.0), delay: float = 0.0) -> Loop:
    """The loop at an orientation (3,), roll, pitch, yaw, rad, with the centre of mass that the isolator assumes."""
    return loop_of(Plant.from_parameters(parameters), Isolator.from_parameters(parameters), orientation, delay)


def loop_of(plant: Plant, isolator: Isolator, orientation: ArrayLike, delay: float) -> Loop:
    """As :func:`loop_at`, of an isolator that may know another mechanism and payload than those of the plant."""
    orientation = np.asarray(orientation, dtype=np.float64)
    command = inverse_kinematics(plant.manipulator.geometry, orientation).coarse_displacement
    return Loop(plant.linearise(command), isolator.controller(orientation), delay)


def _delayed(s: Complex, delay: float) -> Complex:
    return np.asarray(np.exp(-s * delay))[..., None, None]


def _distinct(values: Complex) -> Complex:
    """Values that differ by more than 1e-6 of their modulus."""
    kept: list[complex] = []
    for value in values:
        if all(abs(value - other) > 1e-6 * abs(value) for other in kept):
            kept.append(complex(value))
    return np.array(kept)


FINE_FORCES = [f"fine_force_{i}" for i in (1, 2, 3)]  # N
BASE_WRENCH = [f"base_{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]  # N, N.m, in B at its origin
OUTPUT_NAMES = [name.replace(".", "_") for signal in OUTPUTS for name in signal.names]
BASE_ACCELERATION = OUTPUT_NAMES[:6]


def plant_system(model: PlantModel) -> StateSpace:
    """The plant about its pose, coarse legs at rest: from fine forces and base wrench (9) to all its outputs.

    Orientation and coarse displacement are deviations from the pose.  Coordinates that are switched off are left out.
    """
    from control import ss

    A, B, C, D = model.matrices()
    d = model.dynamics
    moving = np.concatenate([d.active, d.active, np.zeros(model.n_states - 2 * d.n, dtype=bool)])
    inputs = np.arange(N_INPUTS) < N_LOADS
    return ss(
        A[np.ix_(moving, moving)],
        B[np.ix_(moving, inputs)],
        C[:, moving],
        D[:, inputs],
        inputs=FINE_FORCES + BASE_WRENCH,
        outputs=OUTPUT_NAMES,
        name="plant",
    )


def controller_system(controller: Controller) -> StateSpace:
    """The practical controller (55): from base acceleration (6) to fine forces (3)."""
    from control import ss

    return ss(*controller.matrices(), inputs=BASE_ACCELERATION, outputs=FINE_FORCES, name="isolator")


@dataclass(frozen=True)
class Margins:
    """One element of L as a Bode diagram: what Fig 10 and section 4.2 state."""

    largest_gain_db: float
    largest_gain_at: float
    """Hz."""
    gain_crossings: tuple[float, ...]
    """Hz, where the gain passes 0 dB."""
    phase_crossings: tuple[float, ...]
    """Hz, where the phase passes -180 deg while the gain is above 0 dB."""
    phase_margin: float
    """deg, phase above -180 deg at the last gain crossing; nan without one."""


def element_margins(loop: Loop, band: tuple[float, float], row: int = 0, column: int = 0) -> Margins:
    """Margins of +L[row, column] against the point -1, over a band of frequencies, Hz."""

    def element(f: ArrayLike) -> Complex:
        return loop.transfer(2j * np.pi * np.asarray(f))[..., row, column]

    return margins(element, place_frequencies(loop.plant_poles(), *band, 1500))


def margins(element: Callable[[ArrayLike], Complex], frequency: Array) -> Margins:
    """Margins of a function of frequency (Hz) against the point -1.

    It is searched at the frequencies (n,), and then followed between them.
    """

    def transfer(f: Array) -> Complex:
        return element(f)[:, None, None]

    def gain_db(f: Array) -> Array:
        return np.asarray(20.0 * np.log10(np.abs(element(f))))

    L = transfer(frequency)
    crossings = find_crossings(transfer, frequency, L, lambda one: np.log(np.abs(one)), np.inf)
    turning = find_crossings(transfer, frequency, L, lambda one: np.angle(-one), np.pi)
    phase_margin = float(np.degrees(np.angle(-crossings[-1][1]))) if crossings else np.nan
    return Margins(
        *find_peak(gain_db, frequency),
        tuple(f for f, _ in crossings),
        tuple(f for f, value in turning if abs(value) > 1.0),
        phase_margin,
    )


class Peak(NamedTuple):
    """The largest value over frequency."""

    value: float
    at: float
    """Hz."""


def find_peak(function: Callable[[Array], Array], frequency: Array) -> Peak:
    """Largest value of a function of frequency, and where, Hz: on the grid (n,), Hz, then between its neighbours."""
    from scipy.optimize import minimize_scalar

    top = int(np.clip(function(frequency).argmax(), 1, len(frequency) - 2))
    found = minimize_scalar(
        lambda f: -float(function(np.array([f]))[0]), bounds=(frequency[top - 1], frequency[top + 1]), method="bounded"
    )
    return Peak(-float(found.fun), float(found.x))
