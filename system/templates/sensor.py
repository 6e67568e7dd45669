"""Sensor in place of InertialSensors: accelerometers with a bandwidth and a bias.

It measures the acceleration of the bus, and its angular acceleration, with a low-pass of first order.
"""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave, vector


class Sensor(Slave):
    model_description = "Accelerometers with a bandwidth and a bias"

    # Names decide: outputs and inputs of these names are wired, see `ps-fmu list InertialSensors.ssd 'sensors.*'`.
    ports = (
        *vector("base_acceleration", "xyz", "m/s2", "Acceleration of the bus, in B", causality="input"),
        *vector("base_angular_acceleration", "xyz", "rad/s2", "Angular acceleration, in B", causality="input"),
        *vector("estimated_acceleration", "xyz", "m/s2", "Acceleration as measured, in B", causality="output"),
        *vector("estimated_angular_acceleration", "xyz", "rad/s2", "The same, angular", causality="output"),
        Port("bandwidth", "parameter", "Hz", "Of the low-pass", start=300.0, min=1.0),
        *vector("bias", "xyz", "m/s2", "Bias of the acceleration, in B", causality="parameter"),
    )
    n_states = 6  # the measured quantities without bias
    n_auxiliary = 1  # the number 1, which the bias is multiplied with

    def configure(self):
        """Start: the states are zero."""
        self.x[:], self.a[:] = 0.0, 1.0

    def step_map(self, h):
        """The matrix of a step of h (s): [outputs; states] at its end from [states; inputs; 1] at its start."""
        keep = np.exp(-2 * np.pi * self.value("bandwidth") * h)
        filtered = np.hstack([keep * np.eye(6), (1 - keep) * np.eye(6), np.zeros((6, 1))])
        measured = filtered.copy()
        measured[:3, -1] = self.values("bias")
        return np.vstack([measured, filtered])
