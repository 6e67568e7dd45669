"""Toy: a pendulum whose step is a function of a library of its own."""

import ctypes

import numpy as np

from ps_fmu.slavekit.author.elements import Call
from ps_fmu.slavekit.author.slave import Port, Slave


class Arguments(ctypes.Structure):
    _fields_ = (("places", ctypes.c_int64 * 6), ("rate", ctypes.c_double), ("most", ctypes.c_double))


class Pendulum(Slave):
    ports = (
        Port("angle", "output", "rad", "Angle at the end of the step"),
        Port("passes", "output", "1", "How often the input `locked` has changed"),
        Port("torque", "input", "N.m", "Torque"),
        Port("locked", "input", type="Boolean", description="It stands still", event=False),
        Port("library", "parameter", type="String", description="The file of the function"),
        Port("rate", "parameter", "rad/s", "Of small angles", start=3.0),
        Port("most", "parameter", "rad", "Largest angle", start=1.0),
    )
    n_states = 2
    n_memory = 2
    any_step = True
    default_step = 0.01  # s

    def configure(self) -> None:
        self.x[:] = 0.3, 0.0
        self.y[:] = 0.3, 0.0
        self.memory[:] = 0.0

    def before_map(self, h):
        if not self.value("library"):
            return []
        library = ctypes.CDLL(self.value("library"))
        layout = self.layout
        places = [layout.x.start, *map(layout.find, ("torque", "locked", "angle", "passes")), layout.memory.start]
        arguments = Arguments((ctypes.c_int64 * 6)(*places), self.value("rate"), self.value("most"))
        target = np.concatenate([self.places(view) for view in (self.x, self.y, self.memory)])
        return [Call(ctypes.cast(library.swing, ctypes.c_void_p).value, arguments, target)]

    def step_map(self, h):
        return None
