"""Toy: a resonant circuit by its differential equations, with a switch that an element reads."""

import numpy as np

from ps_fmu.slavekit.author.elements import Product
from ps_fmu.slavekit.author.slave import Port, Slave


class Circuit(Slave):
    ports = (
        Port("charge", "output", "A.s", "Charge"),
        Port("voltage", "output", "V", "Of the coil"),
        Port("source", "input", "V", "Source"),
        Port("closed", "input", type="Boolean", start=True, event=False, description="The source is connected"),
        Port("resistance", "parameter", "V/A", "Resistance", start=0.5),
    )
    n_states = 2  # charge, current
    n_auxiliary = 1  # what acts of the source
    default_step = 0.01  # s

    def configure(self) -> None:
        self.x[:] = 0.1, 0.0
        self.a[:] = self.u * self.value("closed")

    def before_map(self, h):
        return [Product(self.u, self.view("closed"), self.a)]

    def continuous(self):
        A = np.array([[0.0, 1.0], [-100.0, -self.value("resistance")]])
        B = np.array([[0.0, 0.0], [0.0, 1.0]])
        return A, B, np.array([[1.0, 0.0], [-100.0, -self.value("resistance")]]), np.array([[0.0, 0.0], [0.0, 1.0]])

    def linearise(self):
        """The source acts by the switch."""
        A, B, C, D = self.continuous()
        closed = np.array([[self.value("closed")]])
        acting = self.u * closed[0]
        return (A, B[:, 1:] @ closed, C, D[:, 1:] @ closed), A @ self.x + B[:, 1] * acting
