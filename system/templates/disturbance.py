"""Disturbance in place of DisturbanceSource: a sine on the bus, as of a cooler.

It rises from zero over the first second, so that the bus keeps no momentum of a sudden start.
"""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave, vector


class Disturbance(Slave):
    model_description = "A sine of force and torque on the bus"

    # Names decide: outputs of these names are wired, see `ps-fmu list isolation 'disturbance.base*'`.
    ports = (
        *vector("base_force", "xyz", "N", "Force on the bus at the origin of B, in B", causality="output"),
        *vector("base_torque", "xyz", "N.m", "Torque on the bus about the origin of B, in B", causality="output"),
        Port("frequency", "parameter", "Hz", "Of the sine", start=52.0, min=0.0),
        *vector("force_amplitude", "xyz", "N", "In B", causality="parameter", start=[0.05, 0.0, 0.02]),
        *vector("torque_amplitude", "xyz", "N.m", "In B", causality="parameter", start=[0.0, 0.01, 0.0]),
    )
    n_auxiliary = 6  # the wrench, which an event computes before each step

    def configure(self):
        """Zero at the start, and an event before the first step."""
        self.y[:] = 0.0
        self.request_event()

    def step_map(self, h):
        """Outputs are the wrench."""
        return np.eye(6)

    def event(self, t, h):
        """The wrench at the end of the step from t to t + h (s); True: before the next step as well."""
        time = t + h - self.start_time
        rise = min(time, 1.0) ** 2 * (3.0 - 2.0 * min(time, 1.0))
        amplitude = np.concatenate([self.values("force_amplitude"), self.values("torque_amplitude")])
        self.a[:] = rise * np.sin(2 * np.pi * self.value("frequency") * time) * amplitude
        return True
