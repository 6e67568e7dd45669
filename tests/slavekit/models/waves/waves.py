"""Toy: outputs that are functions of time, by an event before each step."""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave


class Waves(Slave):
    ports = (
        Port("wave", "output", "N", "A sine"),
        Port("clock", "output", "s", "Time"),
        Port("gain", "input", "1", "Factor of the sine", start=1.0, event=True),
        Port("frequency", "parameter", "Hz", "Frequency", start=3.0, min=0.0),
    )
    n_auxiliary = 2  # the outputs

    def configure(self) -> None:
        self.y[:] = 0.0, self.start_time
        self.request_event()

    def step_map(self, h):
        return np.eye(2)

    def event(self, t, h):
        self.a[:] = self.value("gain") * np.sin(2 * np.pi * self.value("frequency") * (t + h)), t + h
        return True
