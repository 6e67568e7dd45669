"""Toy: outputs from tables."""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave


class Waves(Slave):
    ports = (
        Port("wave", "output", "N", "A sine"),
        Port("clock", "output", "s", "Time"),
        Port("gain", "input", "1", "Factor of the sine", start=1.0, event=True),
        Port("frequency", "parameter", "Hz", "Frequency", start=3.0, min=0.0),
    )
    n_memory = 1  # gain
    block_rows = 64

    def configure(self) -> None:
        self.tables: list[tuple[float, int]] = []
        self.memory[0] = self.value("gain")
        self.y[:] = 0.0, self.start_time

    def rows(self, t, h, n):
        self.tables.append((t, n))
        times = self.times(t, h, n)
        return np.column_stack([self.memory[0] * np.sin(2 * np.pi * self.value("frequency") * times), times])

    def event(self, t, h):
        self.memory[0] = self.value("gain")
        self.discard_rows()
        return False
