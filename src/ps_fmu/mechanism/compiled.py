"""The mechanism in any motion, as compiled functions: ``native/mechanism``, made from :mod:`.equations`.

:class:`Mechanism` holds the parameters for the functions, :class:`Point` all that there is at a state.  ``mechanism.h``
says what state, input and output are.
"""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from ctypes import POINTER, Structure, c_double, c_int64, c_void_p
from functools import cache, lru_cache

import numpy as np
from numpy.typing import NDArray

from ..numerics.library import find_library as find_numerics
from .modes import MOST_BUS_MODES, MOST_PAYLOAD_MODES, MOST_TRUSS_MODES, BusMode, PayloadMode, TrussMode, drop_unused
from .parameters import Bus, CoarseLeg, CoarseServo, Manipulator, Optics, Payload
from .quantities import Array, ParameterError
from .signals import N_OUTPUTS

#: Sizes of the input, and of the largest state.
N_MOVING_INPUTS = 27
MOST_STATES = 2 * (12 + MOST_BUS_MODES + MOST_TRUSS_MODES + MOST_PAYLOAD_MODES) + 9
_UPPER = np.triu_indices(3)


def _fields(**sizes: int) -> list[tuple[str, type]]:
    return [(name, c_double * size if size > 1 else c_double) for name, size in sizes.items()]


class Mode(Structure):
    """``Mode`` of mechanism.h."""

    _fields_ = tuple(_fields(momentum=6, inertia=6, stiffness=1, damping=1, mass=1, mobility=1, sight=2))


class _Mechanism(Structure):
    """``Mechanism`` of mechanism.h."""

    _fields_ = (
        *_fields(
            base_joint=18, platform_joint=18, leg=30, payload=10, payload_less=36, payload_turning=36, bus=10,
            bus_less=36, nominal_lengths=6, leg_stiffness=6, leg_damping=6, mask=12, servo_stiffness=1,
            servo_damping=1, focal_length=1, radius=1,
        ),
        ("n_bus", c_int64), ("n_payload", c_int64),
        ("bus_modes", Mode * MOST_BUS_MODES), ("payload_modes", Mode * (MOST_TRUSS_MODES + MOST_PAYLOAD_MODES)),
    )  # fmt: skip


class Place(Structure):
    """``Place`` of mechanism.h."""

    _fields_ = tuple(_fields(translation=3, rotation=9, nominal_translation=3, nominal_rotation=9, attitude=4))

    @classmethod
    def of(cls, translation_B: Array, rotation_BP: Array, nominal: tuple[Array, Array], attitude: Array) -> Place:
        """Of the platform in B, (3,) m and (3, 3); by the coarse legs alone; and the attitude (4,) of B."""
        numbers = np.concatenate([translation_B, rotation_BP.ravel(), nominal[0], nominal[1].ravel(), attitude])
        return cls.from_buffer_copy(numbers.tobytes())


class Point(Structure):
    """``Point`` of mechanism.h."""

    _fields_ = tuple(
        _fields(
            rates=MOST_STATES, outputs=N_OUTPUTS, reaction=6, twist=6, nominal_twist=6, J_pl=36, nominal_J_pl=36,
            accelerations=12, body=6, spin=6, kept=18, lower=66, divisors=12, base_rows=72, motion=81,
            velocity=3, turn=3, position=3, place=34,
        )
    )  # fmt: skip

    def read(self, name: str, *shape: int) -> Array:
        """A field as an array, a copy; the first numbers of it, if ``shape`` has fewer."""
        return np.array(getattr(self, name))[: int(np.prod(shape))].reshape(shape)


@cache
def find_library() -> ctypes.CDLL:
    """The library, with the functions of mechanism.h.  Raises NotCompiledError."""
    library = find_numerics()  # loaded already: an FMU's folder goes with its first instance
    place, many = POINTER(Place), [c_void_p]
    for name, taken, given in (
        ("invert", 3 * many, c_int64),
        ("find_place", 3 * many, c_int64),
        ("evaluate", [place, *(2 * many), POINTER(Point)], c_int64),
        ("differentiate", [POINTER(Point), *(5 * many)], None),
        ("linearise", [POINTER(Point), *(6 * many), c_int64, c_int64], None),
        ("find_masses", 7 * many, None),
        ("find_momentum", [POINTER(Point), *(3 * many)], None),
    ):
        function = getattr(library, f"mechanism_{name}")
        function.argtypes, function.restype = (POINTER(_Mechanism), *taken), given
    return library


class Mechanism:
    """Parameters as the compiled functions take them, and these functions.

    Modes in unused places at the end have no coordinates.  Without servo and optics there is no motion of the coarse
    actuators and no image point.

    Parameters
    ----------
    prescribed: the base moves as its input states; mass and modes of the bus are left out, as without a bus.
    """

    def __init__(
        self,
        manipulator: Manipulator,
        payload: Payload,
        bus: Bus | None,
        servo: CoarseServo | None = None,
        optics: Optics | None = None,
        *,
        prescribed: bool = False,
    ) -> None:
        self.struct = m = _Mechanism()
        prescribed = prescribed or bus is None
        geometry, rods = manipulator.geometry, manipulator.coarse_rods
        m.base_joint[:] = geometry.base_joints_B.ravel()
        m.platform_joint[:] = geometry.platform_joints_P.ravel()
        (upper, lower), firsts, second = leg_moments(manipulator.coarse_legs + manipulator.fine_legs)
        m.leg[:] = np.hstack([upper, lower, *firsts, second]).ravel()
        m.payload[:] = _join(payload.mass, payload.com_P, payload.inertia_P)
        m.nominal_lengths[:], m.radius = geometry.nominal_lengths, geometry.platform_radius
        m.leg_stiffness[:] = [*(3 * [rods.axial_stiffness]), *(leg.stiffness for leg in manipulator.fine_legs)]
        m.leg_damping[3:] = [leg.damping for leg in manipulator.fine_legs]
        m.mask[:] = [*(3 * [float(rods.axial_stiffness > 0.0)]), 1.0, 1.0, 1.0, *(6 * [float(not prescribed)])]
        if servo is not None:
            omega = 2.0 * np.pi * servo.frequency
            m.servo_stiffness, m.servo_damping = omega**2, 2.0 * servo.damping_ratio * omega
        if optics is not None:
            m.focal_length = optics.focal_length
        bus_modes: Sequence[BusMode] = () if bus is None or prescribed else drop_unused(bus.modes)
        payload_modes: Sequence[TrussMode | PayloadMode] = drop_unused((*payload.truss_modes, *payload.modes))
        counts = ("bus", len(bus_modes), len(m.bus_modes)), ("payload", len(payload_modes), len(m.payload_modes))
        for name, found, most in counts:
            if found > most:
                raise ParameterError(f"{name}.modes", f"{found} modes; at most {most} are possible")
        m.n_bus, m.n_payload = len(bus_modes), len(payload_modes)
        less = np.zeros((6, 6))
        if bus is not None and not prescribed:
            m.bus[:] = _join(bus.mass, bus.com_B, bus.inertia_B)
            for to, mode in zip(m.bus_modes, bus_modes, strict=False):
                _fill(to, mode.participation_B, np.zeros(6), 1.0, mode, np.zeros(2))
                less += mode.active * np.outer(mode.participation_B, mode.participation_B)
        m.bus_less[:] = less.ravel()
        less, turning = np.zeros((6, 6)), np.zeros((6, 6))
        sensitivity = 0.0 if optics is None else optics.truss_sensitivity
        for into, own in zip(m.payload_modes, payload_modes, strict=False):
            mass, r, along, moment, sight = own.place_on_payload(sensitivity)
            momentum = mass * np.concatenate([along, np.cross(r, along) + moment])
            inertia = mass * (2.0 * (r @ along) * np.eye(3) - np.outer(r, along) - np.outer(along, r))[_UPPER]
            _fill(into, momentum, inertia, mass, own, sight)
            if own.active:
                less += np.outer(momentum, momentum) / mass
                turning += np.outer(momentum, inertia) / mass
        m.payload_less[:], m.payload_turning[:] = less.ravel(), turning.ravel()
        self._rod_damping = 2.0 * rods.damping_ratio * np.sqrt(rods.axial_stiffness)

    @property
    def n(self) -> int:
        """Number of coordinates, those that are switched off included."""
        return 12 + int(self.struct.n_bus) + int(self.struct.n_payload)

    def describe_coordinates(self) -> tuple[Array, Array, NDArray[np.bool_]]:
        """Stiffness and damping (n,) of each coordinate, and which are not switched off; rods as last damped."""
        m, base = self.struct, np.array([0.0, 0.0, 1.0])
        legs = np.array([[m.leg_stiffness[i], m.leg_damping[i], m.mask[i]] for i in range(6)])
        bus, payload = (
            np.array([[mode.stiffness, mode.damping, mode.mobility] for mode in modes[:count]]).reshape(-1, 3)
            for modes, count in ((m.bus_modes, m.n_bus), (m.payload_modes, m.n_payload))
        )
        stiffness, damping, moves = np.concatenate([legs[3:], np.tile(base, (6, 1)), bus, legs[:3], payload]).T
        return stiffness, damping, moves > 0.0

    def damp_rods(self, M: Array) -> Array:
        """Damping (3,) of the coarse rods, N.s/m, with the masses that they carry in M (n, n); taken from then on."""
        first = 9 + int(self.struct.n_bus)
        damping = self._rod_damping * np.sqrt(M.diagonal()[first : first + 3])
        self.struct.leg_damping[:3] = damping
        return np.asarray(damping)

    @property
    def n_states(self) -> int:
        """Size of the state."""
        return 2 * self.n + 9

    def evaluate(self, place: Place, x: Array, u: Array) -> Point:
        """All that there is at a state (n_states,) with an input (27,).

        Raises ArithmeticError: the place is singular, or something is not finite.
        """
        point, x, u = Point(), np.ascontiguousarray(x, dtype=float), np.ascontiguousarray(u, dtype=float)
        if x.shape != (self.n_states,) or u.shape != (N_MOVING_INPUTS,):
            raise ValueError(f"expected ({self.n_states},) states and ({N_MOVING_INPUTS},) inputs")
        if not find_library().mechanism_evaluate(self.struct, place, x.ctypes.data, u.ctypes.data, point):
            raise ArithmeticError("the mechanism is singular at this place, or something is not finite")
        return point

    def linearise(self, point: Point) -> tuple[Array, Array, Array, Array, Array, Array]:
        """A, B, C, D about a point, and the reaction by state and input (6, ...)."""
        n, m = self.n_states, N_MOVING_INPUTS
        A, B, C, D, E, F = (np.empty((rows, columns)) for rows in (n, N_OUTPUTS, 6) for columns in (n, m))
        data = (matrix.ctypes.data for matrix in (A, B, C, D, E, F))
        find_library().mechanism_linearise(self.struct, point, *data, 0, n + m)
        return A, B, C, D, E, F

    def differentiate(self, point: Point, dx: Array, du: Array) -> tuple[Array, Array, Array]:
        """Derivatives of rates, outputs and reaction along one direction."""
        dx, du = np.ascontiguousarray(dx, dtype=float), np.ascontiguousarray(du, dtype=float)
        result = np.empty(self.n_states), np.empty(N_OUTPUTS), np.empty(6)
        find_library().mechanism_differentiate(
            self.struct, point, dx.ctypes.data, du.ctypes.data, *(each.ctypes.data for each in result)
        )
        return result

    def find_masses(self, t: Array, R: Array, J_pl: Array, q: Array | None = None) -> tuple[Array, Array, Array]:
        """M (n, n), m_c (n, 3) and the mass (6, 6) of legs and payload as one body on the base, at a pose."""
        result = np.empty((self.n, self.n)), np.empty((self.n, 3)), np.empty((6, 6))
        t, R, J_pl = (np.ascontiguousarray(each) for each in (t, R, J_pl))
        find_library().mechanism_find_masses(
            self.struct, t.ctypes.data, R.ctypes.data, J_pl.ctypes.data, None if q is None else q.ctypes.data,
            *(each.ctypes.data for each in result),
        )  # fmt: skip
        return result

    def find_momentum(self, point: Point, x: Array) -> tuple[Array, float, Array]:
        """Momentum (6,) about the origin of B, mass (kg) and centre of mass (3,), at a point with the state x."""
        momentum, mass = np.empty(6), np.empty(4)
        find_library().mechanism_find_momentum(
            self.struct, point, np.ascontiguousarray(x).ctypes.data, momentum.ctypes.data, mass.ctypes.data
        )
        return momentum, float(mass[0]), mass[1:] / mass[0]

    def find_place(self, lengths: Array, t: Array, R: Array) -> tuple[Array, Array]:
        """The place of the platform with leg lengths (6,), m, from one that is near.

        Raises ArithmeticError: there is none.
        """
        t, R, lengths = np.array(t), np.array(R), np.ascontiguousarray(lengths)
        if not find_library().mechanism_find_place(self.struct, lengths.ctypes.data, t.ctypes.data, R.ctypes.data):
            raise ArithmeticError("no place of the platform has these leg lengths")
        return t, R


@lru_cache(maxsize=8)
def leg_moments(legs: tuple[CoarseLeg, ...]) -> tuple[tuple[Array, Array], tuple[Array, Array], Array]:
    """Mass (kg) and first moment from its own joint (kg.m) of upper and lower parts, second moment of both (kg.m2).

    All (legs, 1), along the leg; read-only.
    """
    upper, lower = (
        np.array([[part.mass, part.com_distance, part.radial_inertia] for part in parts]).T[..., None]
        for parts in ([leg.upper for leg in legs], [leg.lower for leg in legs])
    )
    second = np.asarray(sum(inertia + mass * com**2 for mass, com, inertia in (upper, lower)))
    moments = (upper[0], lower[0]), (upper[0] * upper[1], lower[0] * lower[1]), second
    for array in (upper, lower, *moments[1], second):
        array.setflags(write=False)
    return moments


def _join(mass: float, com: Array, inertia_com: Array) -> Array:
    """(10,) mass, first moment and inertia about the origin."""
    inertia = inertia_com + mass * (com @ com * np.eye(3) - np.outer(com, com))
    return np.concatenate([[mass], mass * com, inertia[_UPPER]])


def _fill(
    to: Mode, momentum: Array, inertia: Array, mass: float, mode: BusMode | TrussMode | PayloadMode, sight: Array
) -> None:
    omega = 2.0 * np.pi * mode.frequency
    to.momentum[:], to.inertia[:], to.sight[:] = momentum, inertia, sight
    to.stiffness, to.damping = omega**2 * mass, 2.0 * mode.damping_ratio * omega * mass
    to.mass, to.mobility = mass, 1.0 / mass if mode.active else 0.0
