"""Toy: a sampled channel that follows its input at a limited rate; a delay and a resolution behind it."""

import numpy as np

from ps_fmu.slavekit.author.elements import (
    Clip,
    Count,
    Delay,
    Hold,
    Linear,
    Quantise,
    Ramp,
    Sample,
    Watch,
    ring_size,
)
from ps_fmu.slavekit.author.slave import Port, Slave

LONGEST = 20  # steps of delay


class Channel(Slave):
    ports = (
        Port("reading", "output", "N", "Input, late and in whole multiples of the resolution"),
        Port("followed", "output", "N", "Input, at a limited rate"),
        Port("turns", "output", "1", "How often the input has risen above 0.9 N"),
        Port("far", "output", "1", "Number of events"),
        Port("clipped", "output", type="Boolean", description="The reading is at its limit"),
        Port("signal", "input", "N", "Input", min=-1e300),
        Port("sample_time", "parameter", "s", "Period of sampling", start=0.04, min=0.0),
        Port("delay", "parameter", "s", "Delay of the reading", start=0.06, min=0.0),
        Port("resolution", "parameter", "N", "Of the reading", start=0.01, min=0.0),
    )
    n_states = 2  # followed, and as filtered
    n_auxiliary = 3  # rate, sampled input, events
    default_step = 0.01  # s
    n_memory = 3 + 1 + 1 + 2 + 1 + ring_size(1, LONGEST)

    def configure(self) -> None:
        self.x[:] = self.a[:] = self.memory[:] = 0.0

    def before_map(self, h):
        return [
            Watch(self.u, self.memory[4:5], 0.7),
            Sample(self.u, self.a[1:2], self.memory[0:1], self.value("sample_time")),
            Ramp(self.a[1:2], self.x[0:1], self.a[0:1], 3.0),
            Linear(self.a[1:2], [[2.0]], self.memory[3:4]),  # overflows
        ]

    def step_map(self, h):
        followed = np.array([1.0, 0.0, 0.0, h])  # of both states, input and rate
        filtered = np.array([1.0, 0.0, 0.0, h]) * 0.2 + np.array([0.0, 0.8, 0.0, 0.0])
        matrix = np.zeros((7, 6))
        matrix[0, :4] = filtered
        matrix[1, :4] = matrix[5, :4] = followed
        matrix[6, :4] = filtered
        matrix[3, 5] = 1.0
        return matrix

    def after_map(self, h):
        return [
            Hold(self.y[0:1], self.memory[1:2], self.memory[2:3], self.value("sample_time")),
            Delay(self.y[0:1], self.memory[8:], self.value("delay")),
            Quantise(self.y[0:1], self.value("resolution")),
            Clip(self.y[0:1], -0.6, 0.6, "clipped"),
            Count(self.u, 0.9, self.memory[5:7], self.y[2:3]),
        ]

    def event(self, t, h):
        self.memory[4:5] = self.u
        self.a[2] += 1.0
        return False
