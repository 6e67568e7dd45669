"""The plant over a step, at rest and in motion: ``plant_step`` of ``native/plant``, with what it takes and keeps."""

from __future__ import annotations

import ctypes
from ctypes import Structure, c_double, c_int64, c_void_p
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from ..numerics.library import LANES, Discretisation, MapWords, Room, allocate, find_address, find_library
from .compiled import MOST_STATES, N_MOVING_INPUTS, Mechanism, Place, Point
from .kinematics import jacobians
from .linear_model import Plant
from .quantities import Array, Checked, quantity
from .signals import N_OUTPUTS


def _numbers(**sizes: int) -> list[tuple[str, Any]]:
    return [(name, c_double * size if size > 1 else c_double) for name, size in sizes.items()]


class Centre(Structure):
    """``Centre`` of plant.h."""

    _fields_ = tuple(
        _numbers(coarse=3, fine=3, velocity=3, position=3, rotation=3, attitude=4, step=1, rest=1)
    )


class Memory(Structure):
    """``Memory`` of plant.h: numbers alone."""

    _fields_ = (
        ("moving", c_double), ("present", Centre), ("next", Centre), ("parts", c_double), ("place", Place),
        *_numbers(
            input=N_MOVING_INPUTS, before=MOST_STATES, rates_before=MOST_STATES, step_before=1, momentum=3, angular=3,
            centre=3, at_rest=6, lead=9, promised=6, countdown=1, locked=10, start=3, last=3, excess=3, unused=1,
        ),
    )  # fmt: skip


#: Numbers of a Memory.
N_MEMORY = ctypes.sizeof(Memory) // 8


class _Model(Structure):
    """``Model`` of plant.h."""

    _fields_ = (
        ("centre", Centre), *((name, c_int64) for name in ("parts", "stage", "column")), ("place", Place),
        *_numbers(mass=1, inverse_inertia=9),
        *((name, c_void_p) for name in ("A", "motion", "change", "rest", "outputs")), ("rooms", Room * 2),
        *((name, MapWords) for name in ("to_rest", "to_outputs")),
    )  # fmt: skip


class _Plant(Structure):
    """``Plant`` of plant.h."""

    _fields_ = (
        ("mechanism", c_void_p),
        *((name, c_int64) for name in ("prescribed", "state", "input", "output", "memory")), ("nominal", Place),
        *_numbers(rate_limit=1, low=1, high=1, distance=1, angle=1, speed=1),
        ("models", _Model * 2), ("latest", c_int64), ("work", Discretisation),
        *((name, c_void_p) for name in ("unit", "operand", "result")), ("evaluated", c_int64), ("place", Place),
        *_numbers(x=MOST_STATES, u=N_MOVING_INPUTS), ("point", Point), ("centre", Point),
    )  # fmt: skip


@dataclass(frozen=True)
class Renewal(Checked):
    """How far the motion may leave a pose at rest, where the plant is linear."""

    relinearisation_distance: float = quantity(
        "m", "Deviation of a leg's length from its value at rest at which the plant leaves the linear model",
        at_least=1e-9, display="um",
    )  # fmt: skip
    relinearisation_angle: float = quantity(
        "rad", "Turn of the base at which the plant leaves the linear model", at_least=1e-9, at_most=0.1,
        display="mrad",
    )  # fmt: skip
    relinearisation_speed: float = quantity(
        "m/s", "Speed of a coarse leg at which the plant leaves the linear model", at_least=1e-9
    )


#: What is usual.
RENEWAL = Renewal(3e-5, 1e-3, 1e-3)


@cache
def find_step() -> int:
    """The address of ``plant_step``.  Raises NotCompiledError."""
    return ctypes.cast(find_library().plant_step, c_void_p).value or 0


class PlantStep:
    """Arguments of ``plant_step``, and the room that it needs.

    Parameters
    ----------
    command: (3,) m, where the coarse legs are at the start: the damping of the rods belongs to the masses there.
    places: of states, inputs, outputs and memory in the buffer.
    prescribed: the base moves as the host says.

    Raises
    ------
    ArithmeticError: no usable pose has the coarse legs at ``command``.
    """

    def __init__(
        self, plant: Plant, renewal: Renewal, command: Array, places: tuple[int, ...], *, prescribed: bool
    ) -> None:
        geometry, library = plant.manipulator.geometry, find_library()
        self.mechanism = mechanism = Mechanism(
            plant.manipulator, plant.payload, plant.bus, plant.servo, plant.optics, prescribed=prescribed
        )
        lengths = geometry.nominal_lengths + np.append(command, np.zeros(3))
        t, R = mechanism.find_place(lengths, geometry.nominal_translation_B, np.eye(3))
        M, _, _ = mechanism.find_masses(t, R, jacobians(geometry, t, R).J_pl)
        mechanism.damp_rods(M)
        n = mechanism.n_states
        stride, given = _pad(n), n + N_MOVING_INPUTS + 1
        self.kept: list[object] = [mechanism]
        self.words = p = _Plant(ctypes.addressof(mechanism.struct), prescribed, *places)
        pose = geometry.nominal_translation_B, np.eye(3)
        p.nominal = Place.of(*pose, pose, np.zeros(4))
        p.rate_limit, (p.low, p.high) = plant.servo.rate_limit, plant.manipulator.coarse_stroke
        p.distance, p.angle = renewal.relinearisation_distance, renewal.relinearisation_angle
        p.speed = renewal.relinearisation_speed
        unit = self._make_room(stride * n)
        unit.reshape(n, stride)[np.arange(n), np.arange(n)] = 1.0
        p.unit, p.work.room = find_address(unit), find_address(self._make_room(library.discretise_room(n)))
        p.operand = find_address(self._make_room(max(2 * n, given)))
        p.result = find_address(self._make_room(max(stride, _pad(N_OUTPUTS))))
        sizes = ("A", stride * given), ("motion", stride * 2 * n), ("change", _pad(3 + mechanism.n) * n)
        maps = ("rest", stride), ("outputs", _pad(N_OUTPUTS))
        for model in p.models:
            for name, size in (*sizes, *((name, rows * given) for name, rows in maps)):
                setattr(model, name, find_address(self._make_room(size)))
            rooms = [Room(given, rows // LANES) for _, rows in maps]
            model.rooms[:] = rooms
            self.kept += [room.arrays for room in rooms]

    def begin(self, core: Structure) -> None:
        """Places, memory and outputs of the state in the buffer of a core.

        Raises ArithmeticError: no usable pose has its lengths, or something is not finite.
        """
        if not find_library().plant_begin(ctypes.byref(self.words), ctypes.byref(core)):
            raise ArithmeticError("the plant is singular at this pose, or something is not finite")

    def _make_room(self, size: int) -> Array:
        room = allocate(size)
        self.kept.append(room)
        return room


def _pad(rows: int) -> int:
    return -(-rows // LANES) * LANES
