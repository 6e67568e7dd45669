"""The line-of-sight loop around plant and isolator, in closed form: stability, complementary split, what is left.

The payload's rotation in inertial space, in axes of P (3), follows fine forces and base wrench with the isolator on::

    theta = P f + G w_b        P = R^T A (E - F C)^-1,   G: :func:`.transmissibility.from_wrench`

with F the isolator from base displacement to force.  The tracker measures the error, the controller answers with the
force f = K e, and all delays of the chain are one factor d(s)::

    L = P K d        S = (E + L)^-1        theta = S G w_b - S L n

n is the noise of the tracker (rad).  The target enters as -n does.

**Delays.**  The tracker samples each T and puts the value out after a latency tau, where it stays for T; the controller
is exact for inputs that are held, and puts its force out after a delay; the plant holds a force for a communication
step h.  With Z_T = (1 - exp(-s T)) / (s T) for a value that is held::

    d = Z_T exp(-s tau)  Z_h  [Z_c exp(-s (T_c + delay)) for a controller that samples each T_c]

**Complementary split.**  Where the suspension is far above, the isolator with its high-pass frequency w_s cancels the
share H of the bus's rotation, and the loop the share T of what the isolator leaves::

    H = s^2 / (s^2 + 2 zeta w_s s + w_s^2)        T = k d / (1 + k d)
    H + (1 - H) T + (1 - H) (1 - T) = 1           third: what is left

**As the FMUs step** (:func:`close_loop`), at each frequency, around a wired model (:func:`.sampled.connect`).  With
theta the rotation that the tracker sees, f the controller's forces, w all that acts from outside and n the noise::

    theta = G_w w + G_f f,    f = K (n - theta),    y = H_w w + H_f f
    f = K S (n - G_w w),      S = (E + G_f K)^-1

K has the controller as it steps, and what delays the loop.  y is linear in H, so that parts of H that add up to it, by
mode for example, give parts of the loop's answer that add up to that.

**Margins** of an axis are those of the loop cut open there while the others stay closed.  The plant has a pure delay, a
notch and nearly undamped modes, so python-control is given its frequency response, dense around the resonances.  Those
that all axes have in common are the loop's (:func:`.stability.find_common_margins`).  Both presume a stable loop.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from ..control.pointing import PointingFilter
from ..mechanism.quantities import Array, Complex
from .loop import Loop
from .stability import CommonMargins, find_common_margins, find_unstable
from .transfer_matrices import Practical, place_frequencies


@dataclass(frozen=True)
class Timing:
    """What delays the loop, s."""

    sample_time: float
    """Of the tracker."""
    latency: float
    """Of the tracker, from the sample to its output."""
    step: float = 0.0
    """Communication step."""
    control_sample_time: float = 0.0
    control_delay: float = 0.0

    def factor(self, s: ArrayLike) -> Complex:
        """d(s), (...)."""
        z: Complex = np.asarray(s, dtype=complex)
        delay = self.latency + self.control_sample_time + self.control_delay
        held = [_held(np.asarray(z * time)) for time in (self.sample_time, self.step, self.control_sample_time)]
        return np.asarray(np.prod(held, axis=0) * np.exp(-z * delay))


@dataclass(frozen=True, eq=False)
class PointingLoop:
    """The loop at one pose."""

    loop: Loop
    """Plant and isolator.  Its delay includes that of the exchange between them."""
    control: PointingFilter
    timing: Timing
    isolated: bool = True
    """The isolator is on."""

    def plant(self, s: ArrayLike) -> Complex:
        """P(s), fine force (N) to rotation of the payload (rad, P), (..., 3, 3)."""
        s = np.asarray(s, dtype=complex)
        practical = Practical(self.loop.model.dynamics)
        A = self.loop.model.dynamics.pose.rotation_BP.T @ practical.A(s)
        if not self.isolated:
            return np.asarray(A)
        F = self.loop.controller.response(s) * (s * s * np.exp(-s * self.loop.delay))[..., None, None]
        return np.asarray(A @ np.linalg.inv(np.eye(3) - F @ practical.C(s)))

    def transfer(self, s: ArrayLike) -> Complex:
        """L(s), (..., 3, 3)."""
        s = np.asarray(s, dtype=complex)
        return np.asarray(self.plant(s) @ self.control.response(s) * self.timing.factor(s)[..., None, None])

    def axis_transfer(self, s: ArrayLike, axis: int) -> Complex:
        """The loop cut open at one axis, the others closed, (...); critical point -1."""
        return cut_axis(self.transfer(s), axis)

    @cached_property
    def unstable(self) -> Complex:
        """Poles of the closed loops in the right half-plane, rad/s, the one farthest to the right first."""
        return find_unstable(self._characteristic, place_frequencies(self.loop.plant_poles(), 1e-5, 1e4, 150, 8))

    def _characteristic(self, s: Complex) -> Complex:
        """Of both loops, without the integrators' poles at zero, (n,)."""
        inner = self.loop.characteristic(s) if self.isolated else np.ones(s.shape)
        at_rest = (s / (s + 1.0)) ** (3 * self.control.integrators)
        return np.asarray(inner * np.linalg.det(np.eye(3) + self.transfer(s)) * at_rest)

    def frequencies(self, low: float = 1e-3, high: float = 200.0) -> Array:
        """Frequencies, Hz, dense around the resonances of the plant, (n,)."""
        return place_frequencies(self.loop.plant_poles(), low, high, 400, 20)


def cut_axis(L: Complex, axis: int) -> Complex:
    """Loop transfer (...) of one axis with the others closed, of a loop transfer matrix L (..., n, n)."""
    others = [i for i in range(L.shape[-1]) if i != axis]
    closed = np.eye(len(others)) + L[..., others, :][..., others]
    through = np.linalg.solve(closed, L[..., others, axis, None])[..., 0]
    return np.asarray(L[..., axis, axis] - np.sum(L[..., axis, others] * through, axis=-1))


@dataclass(frozen=True, eq=False)
class Split:
    """Shares of the bus's rotation, complex, (...) each; they add up to one at every frequency."""

    isolator: Complex
    """H: cancelled by the isolator."""
    loop: Complex
    """(1 - H) T: cancelled by the loop."""
    left: Complex
    """(1 - H) (1 - T): left to the payload."""


def split(pointing: PointingLoop, s: ArrayLike) -> Split:
    """The complementary split at complex frequencies, rad/s, where the suspension is far above them."""
    s = np.asarray(s, dtype=complex)
    filters = pointing.loop.controller.filters
    omega = 2.0 * np.pi * filters.highpass_frequency  # rad/s
    highpass = s * s / (s * s + 2.0 * filters.highpass_damping_ratio * omega * s + omega**2)
    H = np.asarray(highpass if pointing.isolated else np.zeros_like(s))
    L = pointing.control.design.response(s) * pointing.timing.factor(s)
    T = L / (1.0 + L)
    return Split(H, np.asarray((1.0 - H) * T), np.asarray((1.0 - H) * (1.0 - T)))


def _held(x: Complex) -> Complex:
    """(1 - exp(-x)) / x, (...); 1 at zero."""
    small = np.abs(x) < 1e-8
    safe = np.where(small, 1.0, x)
    return np.asarray(np.where(small, 1.0 - 0.5 * x, -np.expm1(-safe) / safe))


AXES = ("x", "y", "z")

#: What a design has to keep: gain margin in dB, phase margin in deg.
LEAST_GAIN_DB, LEAST_PHASE_DEG = 6.0, 30.0


@dataclass(frozen=True)
class AxisMargins:
    """Margins of one axis with the others closed."""

    axis: str
    gain_db: float
    """Least distance of the gain from 0 dB where the phase is -180 deg, either way; inf: it is nowhere."""
    phase_deg: float
    """Least distance of the phase from -180 deg where the gain is 0 dB, either way; inf: it is nowhere."""
    crossover_hz: float
    """Where that is."""
    modulus: float
    """Least distance of the loop transfer from -1: 1 over the peak of its sensitivity."""


def find_margins(pointing: PointingLoop, frequency: Array | None = None) -> tuple[AxisMargins, ...]:
    """Margins of the three axes in closed form, at frequencies (n,), Hz."""
    frequency = pointing.frequencies() if frequency is None else frequency
    L = pointing.transfer(2j * np.pi * frequency)
    return tuple(margins_of(frequency, cut_axis(L, k), axis) for k, axis in enumerate(AXES))


def keeps_margins(margins: AxisMargins | CommonMargins) -> bool:
    """At least 6 dB and 30 deg."""
    return margins.gain_db >= LEAST_GAIN_DB and margins.phase_deg >= LEAST_PHASE_DEG


def find_loop_margins(pointing: PointingLoop, frequency: Array | None = None) -> CommonMargins:
    """Margins of the loop as a whole in closed form, at frequencies (n,), Hz."""
    frequency = pointing.frequencies() if frequency is None else frequency
    return find_common_margins(lambda f: pointing.transfer(2j * np.pi * f), frequency)


def margins_of(frequency: Array, response: Complex, axis: str) -> AxisMargins:
    """Margins of a loop transfer (n,) of a stable loop at frequencies (n,), Hz, against -1, by python-control."""
    from control import frd, stability_margins  # 1 s to import

    found = stability_margins(frd(response, 2.0 * np.pi * frequency, smooth=True), returnall=True)
    gains, phases, moduli, _, crossings, _ = (np.atleast_1d(values) for values in found)
    gain_db, phases = np.abs(20.0 * np.log10(gains)), np.abs(phases)
    least = int(np.argmin(phases)) if phases.size else None
    return AxisMargins(
        axis,
        gain_db=float(gain_db.min()) if gain_db.size else np.inf,
        phase_deg=float(phases[least]) if least is not None else np.inf,
        crossover_hz=float(crossings[least] / (2.0 * np.pi)) if least is not None else np.nan,
        modulus=float(moduli.min()) if moduli.size else float(np.abs(1.0 + response).min()),
    )


@dataclass(frozen=True, eq=False)
class SampledPointing:
    """Tracker and controller.

    A tracker or controller that samples slower than the steps is replaced by its mean response, without images.
    """

    control: PointingFilter
    timing: Timing
    """Its step is that of communication, s, above 0."""
    roll_measured: bool = True
    """The rotation about the boresight is seen, too."""

    def response(self, s: Complex) -> Complex:
        """K, from the rotation that is to be taken away (3, rad, P) to forces (3, N), (n, 3, 3), at s (n,), rad/s."""
        t, h = self.timing, self.timing.step
        Ad, Bd = self.control.hold(h)
        # In increments: for slow errors the states of the two integrators change by little in a step.
        A, B = (Ad - np.eye(len(Ad))) / h, (Bd[:, :3] / h).astype(complex)
        point = np.expm1(s * h) / h
        K = self.control.output_map() @ np.linalg.solve(point[:, None, None] * np.eye(len(A)) - A, B)
        late = np.exp(-s * (t.latency + t.control_sample_time + t.control_delay))
        for time in (t.sample_time, t.control_sample_time):
            late = late * hold_mean(np.asarray(s * h), time / h)
        return np.asarray(K * late[:, None, None] * np.array([1.0, 1.0, float(self.roll_measured)]))


def close_loop(K: Complex, seen: Complex, answers: Complex, forces: slice) -> Complex:
    """Answers of the closed loop to what acts from outside and to the tracker's noise.

    Parameters
    ----------
    K: (n, 3, 3), see :meth:`SampledPointing.response`.
    seen: [G_w G_f] (n, 3, inputs), of the rotation that the tracker sees.
    answers: [H_w H_f] (..., n, signals, inputs), of any signals.
    forces: where the three inputs f are.

    Returns (..., n, signals, inputs): the columns of the forces are those of the noise n, rad.
    """
    G_f = seen[..., forces]
    demand = K @ np.linalg.inv(np.eye(3) + G_f @ K)  # K S
    from_outside = -demand @ seen
    from_outside[..., forces] = demand
    closed = np.asarray(answers[..., forces] @ from_outside)
    outside = np.ones(seen.shape[-1], dtype=bool)
    outside[forces] = False
    closed[..., outside] += answers[..., outside]
    return closed


def hold_mean(x: Complex, steps: float) -> Complex:
    """Mean of 1, exp(-x) ... exp(-(steps - 1) x), (n,): a value that stays for so many steps, x = s h (n,)."""
    return np.asarray(np.mean(np.exp(-x[:, None] * np.arange(max(round(steps), 1))), axis=1))
