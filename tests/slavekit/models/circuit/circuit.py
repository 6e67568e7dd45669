"""Toy: a resonant circuit by its differential equations."""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave


class Circuit(Slave):
    ports = (
        Port("charge", "output", "A.s", "Charge"),
        Port("voltage", "output", "V", "Of the coil"),
        Port("source", "input", "V", "Source"),
        Port("resistance", "parameter", "V/A", "Resistance", start=0.5),
    )
    n_states = 2  # charge, current
    default_step = 0.01  # s
    provides_derivatives = True

    def configure(self) -> None:
        self.x[:] = 0.1, 0.0

    def continuous(self):
        row = [-100.0, -self.value("resistance")]
        A, one = np.array([[0.0, 1.0], row]), np.array([[0.0], [1.0]])
        return A, one, np.array([[1.0, 0.0], row]), one
