"""Inputs, states and outputs of the plant: their names, and their places in ``u``, ``x`` and ``y``."""

from __future__ import annotations

from .quantities import Signal

_XYZ, _RPY, _123, _WXYZ = ("x", "y", "z"), ("roll", "pitch", "yaw"), ("1", "2", "3"), ("w", "x", "y", "z")

#: Groups of outputs, in the order of ``y``.
OUTPUTS = (
    Signal("base_acceleration", _XYZ, "m/s2", "Acceleration of the origin of B, in B", 1e-3, starts_at_zero=False),
    Signal("base_angular_acceleration", _XYZ, "rad/s2", "Angular acceleration of B, in B", 1e-3, starts_at_zero=False),
    Signal("base_velocity", _XYZ, "m/s", "Velocity of the origin of B, in B", 1e-5, starts_at_zero=False),
    Signal("base_angular_velocity", _XYZ, "rad/s", "Angular velocity of B, in B", 1e-5, starts_at_zero=False),
    Signal("base_position", _XYZ, "m", "Displacement of the origin of B since the start, in B", 1e-5, "um"),
    Signal("base_rotation", _XYZ, "rad", "Small rotation of B since the start, in B", 1e-5, "urad"),
    Signal("payload_position", _XYZ, "m", "Displacement of the origin of P by vibration, in B", 1e-5, "um"),
    Signal("payload_rotation", _XYZ, "rad", "Small rotation of P by vibration (jitter), in P", 1e-6, "urad"),
    Signal("fine_displacement", _123, "m", "Elongation of a fine leg", 1e-6, "um"),
    Signal(
        "coarse_displacement", _123, "m", "Displacement of a coarse actuator from its nominal length", 0.01, "mm", False
    ),
    Signal(
        "orientation", _RPY, "rad", "Orientation of P in B that follows from the coarse actuators alone",
        0.1, "deg", False,
    ),
    Signal(
        "relative_orientation", _RPY, "rad", "Orientation of P in B with fine legs and rod stretch", 0.1, "deg", False
    ),
    Signal("los", ("x", "y"), "m", "Image point of the boresight on the image plane, axes of P", 1e-6, "um"),
    Signal("fine_velocity", _123, "m/s", "Rate of elongation of a fine leg", 1e-5),
    Signal(
        "line_of_sight", ("x", "y"), "rad", "Small rotation of the boresight by vibration, with truss modes, in P",
        1e-6, "urad",
    ),
    Signal(
        "base_attitude", _WXYZ, "1", "Attitude of B, unit quaternion, scalar first, to inertial axes",
        1.0, None, False,
    ),
    Signal(
        "payload_attitude", _WXYZ, "1", "Attitude of P, unit quaternion, scalar first, to inertial axes",
        1.0, None, False,
    ),
)  # fmt: skip

#: What the host's hub feels of the relative motion.
REACTION = (
    Signal("bus_force", _XYZ, "N", "With base = prescribed: force on the host's bus at the origin of B, in B", 0.1),
    Signal(
        "bus_torque", _XYZ, "N.m", "With base = prescribed: torque on the host's bus about the origin of B, in B", 0.1
    ),
)
#: Legs and payload as one rigid body, after their mass in kg.
LOCKED = (
    Signal("locked_com", _XYZ, "m", "Centre of mass of legs and payload at the present pose, in B", 0.1, None, False),
    Signal(
        "locked_inertia", ("xx", "xy", "xz", "yy", "yz", "zz"), "kg.m2",
        "Inertia of legs and payload at the present pose, about the origin of B, in B", 1.0, None, False,
    ),
)  # fmt: skip
#: Size of ``y``.
N_OUTPUTS = sum(len(signal.components) for signal in OUTPUTS)
#: Size of ``u``.
N_INPUTS = 22
#: Fine forces and base wrench, the first inputs.
N_LOADS = 9
#: With further fine forces and payload wrench: what acts from outside.
N_EXTERNAL = 18
ADDED, RATE = slice(9, 12), slice(18, 21)


def output_slices() -> dict[str, slice]:
    """Place of each group in ``y``."""
    places, start = {}, 0
    for signal in OUTPUTS:
        places[signal.name] = slice(start, start + len(signal.components))
        start += len(signal.components)
    return places


def servo_slices(n: int) -> tuple[slice, slice, slice]:
    """Places of ``s``, ``s'`` and ``r`` in the state, for n coordinates."""
    return slice(2 * n, 2 * n + 3), slice(2 * n + 3, 2 * n + 6), slice(2 * n + 6, count_states(n))


def count_states(n: int) -> int:
    """Size of ``x`` for n coordinates."""
    return 2 * n + 9
