"""Toy: a clamped gain and a delay of two steps, by finish_step."""

import numpy as np

from ps_fmu.slavekit.author.slave import ModelError, Port, Slave


class Limiter(Slave):
    ports = (
        Port("limited", "output", "N", "Input, clamped"),
        Port("delayed", "output", "N", "What was limited two steps ago"),
        Port("signal", "input", "N", "Input"),
        Port("limit", "parameter", "N", "Clamp", start=1.0, min=0.0),
    )
    n_memory = 2

    def configure(self) -> None:
        self.finishing = True
        self.memory[:] = 0.0
        self.y[:] = np.clip(self.value("signal"), -self.value("limit"), self.value("limit")), 0.0

    def step_map(self, h):
        return np.array([[1.0], [0.0]])

    def finish_step(self) -> None:
        self.y[1] = self.memory[0]
        self.memory[0] = self.memory[1]
        self.memory[1] = self.y[0] = np.clip(self.y[0], -self.value("limit"), self.value("limit"))
        if self.value("signal") == 13.0:
            raise ModelError("signal = 13 N: unlucky")
