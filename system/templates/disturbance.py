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
    block_rows = 1000  # of the outputs, which are made ahead: their steps need no Python

    def rows(self, t, h, n):
        """Outputs (n, 6) at the ends of the next n steps, t + h to t + n h (s)."""
        time = self.times(t, h, n)
        rise = np.clip(time, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(time, 0.0, 1.0))
        amplitude = np.concatenate([self.values("force_amplitude"), self.values("torque_amplitude")])
        return np.outer(rise * np.sin(2 * np.pi * self.value("frequency") * time), amplitude)
