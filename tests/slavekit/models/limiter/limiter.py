"""Toy: a clamped gain and a delay of two steps, by an event before each."""

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

    n_auxiliary = 1  # what was limited two steps ago

    def configure(self) -> None:
        self.memory[:] = 0.0
        self.y[:] = self._clip(), 0.0
        self.request_event()

    def step_map(self, h):
        return np.array([[1.0, 0.0], [0.0, 1.0]])

    def limits(self):
        bound = np.array([self.value("limit"), np.inf])
        return -bound, bound

    def event(self, t, h):
        self.a[0] = self.memory[0]
        self.memory[:] = self.memory[1], self._clip()
        if self.value("signal") == 13.0:
            raise ModelError("signal = 13 N: unlucky")
        return True

    def _clip(self):
        return np.clip(self.value("signal"), -self.value("limit"), self.value("limit"))
