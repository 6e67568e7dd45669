"""The sensors that the FMU starts with: three triads of seismic accelerometers about the manipulator, no rate sensors.

The figures of the accelerometers are those of ``system/parameters/sensors_seismic.ssv``, where their sources stand.
The places are chosen: 0.5 m from the manipulator's axis, each 120 degrees from the next, in the plane of its base.
The rate sensors, which are off, have figures of the data sheet of Safran's STIM300 (rev. 9).
"""

from __future__ import annotations

import numpy as np

from .inertial import ACCELEROMETERS, InertialSensors
from .parameters import Accelerometer, AccelerometerKind, RateSensor, RateSensorKind

TRIADS = 3
_ARM = 0.5  # m
_PLACES = np.array([[0.0, _ARM, 0.0], [-0.433, -0.25, 0.0], [0.433, -0.25, 0.0], [0.0, 0.0, -_ARM]])  # m, in B

SEISMIC = AccelerometerKind(
    bandwidth=200.0,  # Hz
    order=2,
    noise_density=9.6e-8,  # m/s2/sqrt(Hz)
    bias_instability=5.4e-8,  # m/s2
    random_walk=0.0,  # m/s2/sqrt(s)
    range=1.0,  # m/s2
    resolution=1.2e-7,  # m/s2
    bias_spread=0.0,  # m/s2
    scale_factor_spread=0.0,
    misalignment_spread=0.0,  # rad
)
NO_RATE_SENSORS = RateSensorKind(
    enabled=False,
    bandwidth=262.0,  # Hz
    order=2,
    noise_density=6.2e-5,  # rad/s/sqrt(Hz); angle random walk 0.15 deg/sqrt(h)
    bias_instability=3.7e-6,  # rad/s; lowest Allan deviation 0.5 deg/h
    random_walk=0.0,  # rad/s/sqrt(s)
    range=7.0,  # rad/s; 400 deg/s
    resolution=0.0,  # rad/s
    bias_spread=0.0,  # rad/s
    scale_factor_spread=5e-4,
    misalignment_spread=1e-3,  # rad
)


def default_sensors() -> InertialSensors:
    """Three triads of seismic accelerometers; nine places of twelve are taken."""
    return InertialSensors(
        seed=1,
        sample_time=0.0,  # s
        latency=0.0,  # s
        accelerometer=SEISMIC,
        accelerometers=tuple(_make_accelerometer(k) for k in range(ACCELEROMETERS)),
        rate_sensor=NO_RATE_SENSORS,
        rate_sensors=tuple(RateSensor(0.0, 0.0, np.zeros(3)) for _ in range(RateSensor.AXES)),
    )


def _make_accelerometer(k: int) -> Accelerometer:
    return Accelerometer(
        enabled=k < 3 * TRIADS,
        position_B=_PLACES[k // 3],
        direction_B=np.eye(3)[k % 3],
        bias=0.0,  # m/s2
        scale_factor_error=0.0,
        misalignment_B=np.zeros(3),  # rad
    )
