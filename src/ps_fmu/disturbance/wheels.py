"""Reaction-wheel harmonics with a speed profile.

Each harmonic is a vector in the wheel plane of amplitude C_i W^2 (W: wheel speed) that turns at h_i W.  It is a second
derivative, as the force of an unbalance is::

    f_i = -d2/dt2 [ R C_i / h_i^2 e_i ]    e_i: unit vector at the angle h_i theta + phase_i, theta' = W; R: fade-in
        = R C_i W^2 e_i - ...              the other terms act while the speed changes, W', and during the fade-in

So the momentum that it gives to a free body is bounded by that of a steady wheel, also after a run-up.  A speed that
jumps (a ramp of no duration) leaves momentum: there the second derivative would be an impulse, which is left out.

Coefficients: the two CSV files beside this module, lines ``h_i, C_i`` without header, C_i in N/(rad/s)^2 and
N.m/(rad/s)^2.  They belong to a small reaction wheel in the sample satellite of the spacecraft simulator S2E
(github.com/ut-issl/s2e-core), whose licence is beside them.

Left out: axial force, torque about the spin axis, structural modes of the wheel, gyroscopic moments.
"""

from __future__ import annotations

import csv
import pkgutil
from ctypes import byref, c_int64, pointer
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..mechanism.parameters import Parameters
from ..mechanism.quantities import Array, Complex, ParameterError, quantity
from ..numerics import library
from ..numerics.calls import Calls, Progress, WheelRows
from ..numerics.library import find_address
from ..numerics.normal import Stream, make_key
from .kind import Kind, SharedSettings, Source, explain_folding
from .spectrum import ramp
from .turning import Products, Speed, SpeedProfile, SpeedTable, plan_products

_ROWS = 1024  # computed by a call: 25 us


@dataclass(frozen=True, eq=False)
class Harmonics:
    """Orders h (n,) and coefficients C (n,) of one radial quantity."""

    orders: Array
    coefficients: Array


def read_harmonics(text: str, name: str) -> Harmonics:
    """The content of a file, lines ``h, C`` without header; ``name`` is its name.

    Raises
    ------
    ParameterError: a line does not hold two numbers, h > 0 and C >= 0; the text has its number.
    """
    rows: list[tuple[float, float]] = []
    for number, fields in enumerate(csv.reader(text.splitlines()), 1):
        where = f"{name}, line {number}"
        try:
            order, coefficient = (float(field) for field in fields)
        except ValueError:
            raise ParameterError(where, f"expected two numbers, got {fields!r}") from None
        if not (0.0 < order < np.inf and 0.0 <= coefficient < np.inf):
            raise ParameterError(where, f"expected h > 0 and C >= 0, got {fields!r}")
        rows.append((order, coefficient))
    if not rows:
        raise ParameterError(name, "holds no harmonics")
    orders, coefficients = np.array(rows).T
    return Harmonics(orders, coefficients)


def _read_packaged(name: str) -> Harmonics:
    return read_harmonics((pkgutil.get_data(__name__, name) or b"").decode(), name)  # an FMU has it in an archive


# Read when the module is: an FMU's folder goes with its first instance, while others still run its code.
FORCE = _read_packaged("wheel-radial-force-harmonics.csv")
TORQUE = _read_packaged("wheel-radial-torque-harmonics.csv")


class WheelSource:
    """Wrench of one wheel on the bus, faded in from rest over the rise time.

    Parameters
    ----------
    profile: speed over time.
    spin_axis_B: direction of the spin axis (3,), any length but zero.
    position_B: centre of the wheel (3,), m.
    seed: initial phases of the harmonics.
    scale: factor on force and torque.
    rise_time: s.
    force, torque: harmonics (default: those of S2E).
    """

    rows_at_once: ClassVar[int] = _ROWS
    """Times whose rows take little time."""

    def __init__(
        self,
        profile: Speed,
        spin_axis_B: Array,
        position_B: Array,
        seed: tuple[int, ...],
        scale: float = 1.0,
        rise_time: float = 2.0,
        force: Harmonics | None = None,
        torque: Harmonics | None = None,
    ) -> None:
        force, torque = force or FORCE, torque or TORQUE
        self.profile = profile
        self._rise_time = rise_time
        self._orders = np.concatenate([force.orders, torque.orders])
        random = np.random.Generator(np.random.Philox(np.random.SeedSequence(seed)))
        self._phases = 2.0 * np.pi * random.random(self._orders.size)
        one_B, other_B = wheel_plane(spin_axis_B)
        # Wrench at the origin per squared speed: along the one direction with the cosine, the other with the sine.
        along = np.stack([self._wrenches(v, position_B) for v in (one_B, other_B)], axis=1)  # (2, 2, 6)
        coefficients = np.concatenate([force.coefficients, torque.coefficients])
        lines = scale * coefficients * np.exp(1j * self._phases)
        is_torque = np.arange(self._orders.size) >= force.orders.size
        self._amplitudes = lines[:, np.newaxis] * (along[:, 0] - 1j * along[:, 1])[is_torque.astype(np.intp)]
        plan = plan_products(tuple(dict.fromkeys(self._orders.tolist())))  # force and torque share orders
        which = [plan.place[order] for order in self._orders.tolist()]
        self._turning = _Turning(plan, which, _integrate(lines, self._orders), force.orders.size, along)
        self._whole = None
        """For the compiled wheel, where the speed is no table."""
        if isinstance(profile, SpeedProfile):
            ends = profile.initial, profile.final, profile.start, profile.duration
            self._whole = library.Profile(*ends, rise_time)

    @property
    def orders(self) -> Array:
        """Harmonics h (n,), those of the force before those of the torque."""
        return self._orders

    def amplitudes(self, speed: float) -> Complex:
        """Complex amplitudes a (n, 6), N and N.m in B at its origin, of the harmonics at a constant speed, rad/s.

        After the fade-in the wrench is the real part of the sum of ``a_i exp(j h_i angle)``.
        """
        return np.asarray(speed**2 * self._amplitudes)

    @staticmethod
    def _wrenches(direction_B: Array, position_B: Array) -> Array:
        """Wrenches at the origin of a force and of a torque along a direction, (2, 6)."""
        of_force = np.concatenate([direction_B, np.cross(position_B, direction_B)])
        return np.stack([of_force, np.concatenate([np.zeros(3), direction_B])])

    def __call__(self, time: Array) -> Array:
        """Force (N) and torque (N.m) in B at its origin at the times (n,) in s, shape (n, 6)."""
        wrench, time = np.zeros((time.size, 6)), np.ascontiguousarray(time, dtype=np.float64)
        for first in range(0, time.size, _ROWS):
            part = slice(first, first + _ROWS)
            if calls := self.make_calls(wrench[part], time[part]):
                calls.finish()
            else:
                self._turning.add(wrench[part], self.profile.angle(time[part]), self._compute_sizes(time[part]))
        return wrench

    def make_calls(self, rows: Array, time: Array) -> Calls | None:
        """Calls that add the wrench at the times (n,), s, to rows (n, 6); None: it is not all compiled."""
        return None if self._whole is None else self._turning.make_calls(rows, time, self._whole)

    def _compute_sizes(self, time: Array) -> Array:
        """What the sums over the harmonics and over their first and second integrals are multiplied by, (m, n).

        Sums that nothing is left of at the end are left out.
        """
        speed, acceleration = self.profile.speed(time), self.profile.acceleration(time)
        if time.min() >= self._rise_time:
            return np.stack([speed**2, -acceleration] if acceleration.any() else [speed**2])
        rise = ramp(time, self._rise_time)
        # With e = (cos, sin) and d = (-sin, cos): -(R e/h^2)'' = R W^2 e - (R W' + 2 R' W) d/h - R'' e/h^2.
        sizes = np.stack([
            rise.value * speed**2, -(rise.value * acceleration + 2.0 * rise.rate * speed), -rise.curvature
        ])  # fmt: skip
        return sizes if sizes[2].any() else sizes[:2] if sizes[1].any() else sizes[:1]


def _integrate(amplitudes: Complex, orders: Array) -> Complex:
    """Amplitudes of the sums over harmonics (k, ...) and over their first and second integrals, (3, k, ...)."""
    per_order = (1.0 / orders).reshape(-1, *[1] * (amplitudes.ndim - 1))
    return np.stack([amplitudes, 1j * per_order * amplitudes, per_order**2 * amplitudes])


class _Turning:
    """Sums of what turns with the multiples of an angle.

    Parameters
    ----------
    plan: how their multiples are made.
    which: of these, of each harmonic of the force, then of the torque.
    amplitudes: of each sum, (m, k).
    n_force: how many harmonics belong to the force.
    along: wrenches of force and torque along two directions, which go with the cosine and with the sine, (2, 2, 6).
    """

    def __init__(self, plan: Products, which: list[int], amplitudes: Complex, n_force: int, along: Array) -> None:
        self._multiples = np.array(plan.turned) / (2.0 * np.pi)
        self._amplitudes = amplitudes
        products = [library.Product(*product) for product in plan.products]
        counts = len(plan.turned), len(products)
        self._room = library.allocate(2 * library.PART * sum(counts))
        self._shared = library.Turning(
            find_address(self._multiples), (library.Product * len(products))(*products),
            (c_int64 * len(which))(*which), find_address(amplitudes), *counts, n_force, len(which),
        )  # fmt: skip
        for row, wrench in zip(self._shared.along, along.reshape(4, 6).tolist(), strict=True):
            row[:] = wrench
        found: Any = library.find_arithmetic()
        self._add, self._add_some = found.add_turning, found.add_some_turns

    def add(self, rows: Array, angle: Array, sizes: Array) -> None:
        """Add the first sums, each multiplied by its sizes (m, n), at the angles (n,), rad, to ``rows`` (n, 6)."""
        shared, (n_terms, n), room = byref(self._shared), sizes.shape, find_address(self._room)
        self._add(shared, find_address(angle), n, find_address(sizes), n_terms, room, find_address(rows))

    def make_calls(self, rows: Array, time: Array, profile: library.Profile) -> Calls:
        """Calls that add all three sums, as a wheel's speed has them, to contiguous rows (n, 6) at times (n,), s."""
        given = WheelRows(
            Progress(find_address(rows), time.size, _ROWS), pointer(self._shared), pointer(profile),
            find_address(time), find_address(self._room),
        )  # fmt: skip
        return Calls([(self._add_some, given)] * -(-time.size // _ROWS), self, rows, time)


def wheel_plane(spin_axis: Array) -> tuple[Array, Array]:
    """Two unit vectors that form a right-handed triad with the spin axis."""
    axis = spin_axis / np.linalg.norm(spin_axis)
    helper = np.eye(3)[np.argmin(np.abs(axis))]
    one = np.cross(helper, axis)
    one /= np.linalg.norm(one)
    return one, np.cross(axis, one)


@dataclass(frozen=True, eq=False)
class WheelSettings(Kind):
    """A reaction wheel: where it is and how its speed goes."""

    name: ClassVar[str] = "wheels"

    enabled: bool = quantity("", "True: the wheel acts")
    scale: float = quantity("1", "Factor on the wheel's force and torque", at_least=0.0)
    spin_axis_B: Array = quantity("1", "Direction of the spin axis, in B", shape=(3,))
    position_B: Array = quantity("m", "Centre of the wheel, in B", shape=(3,))
    initial_speed: float = quantity("rad/s", "Speed before the ramp", display="rpm")
    final_speed: float = quantity("rad/s", "Speed after the ramp", display="rpm")
    ramp_start: float = quantity("s", "Time at which the speed begins to change")
    ramp_duration: float = quantity("s", "Duration of the change of speed", at_least=0.0)
    speed_profile: str = quantity(
        "", "CSV file with time [s] and speed [rpm], used in place of the ramp; empty: the ramp"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if np.linalg.norm(self.spin_axis_B) < 1e-9:
            raise ParameterError("spin_axis", "must not be the zero vector")
        if not isinstance(self.speed_profile, str):
            raise ParameterError("speed_profile", f"expected text, got {self.speed_profile!r}")

    @cached_property
    def profile(self) -> Speed:
        """How the speed goes.  Raises ParameterError: the file cannot be used."""
        if self.speed_profile:
            return SpeedTable.read(Path(self.speed_profile), "speed_profile")
        return SpeedProfile(self.initial_speed, self.final_speed, self.ramp_start, self.ramp_duration)

    @classmethod
    def make_defaults(cls, p: Parameters) -> tuple[WheelSettings, ...]:
        """Four wheels at the centre of mass of the bus, switched off: three along the axes of B, one skewed."""
        return tuple(
            cls(
                enabled=False,
                scale=1.0,
                spin_axis_B=np.array(axis),
                position_B=p.bus.com_B,
                initial_speed=200.0,  # rad/s
                final_speed=200.0,  # rad/s
                ramp_start=0.0,  # s
                ramp_duration=0.0,  # s
                speed_profile="",
            )
            for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0))
        )

    def make_source(self, shared: SharedSettings, number: int) -> Source | None:
        """The wheel; its initial phases depend on seed and number.  Raises ParameterError for an unusable profile."""
        if not self.enabled:
            return None
        seed = make_key(Stream.WHEEL, shared.seed, number)
        return WheelSource(self.profile, self.spin_axis_B, self.position_B, seed, self.scale, shared.rise_time)

    def explain_aliasing(self, h: float) -> str | None:
        """That the steps fold the highest harmonic at the highest speed."""
        if not self.enabled:
            return None
        speed = self.profile.highest
        order = max(FORCE.orders.max(), TORQUE.orders.max())
        return explain_folding(f"harmonic {order:g} of {speed:g} rad/s", order * speed / (2.0 * np.pi), h)
