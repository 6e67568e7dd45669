"""Sends SIGINT to its own process in the middle of a step, or of the initialisation where that is before zero."""

import os
import signal

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class ToyInterrupting(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.at = 0.05
        self.clock = 0.0
        self.register_variable(Real("at", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed))
        self.register_variable(Real("clock", causality=Fmi2Causality.output))

    def exit_initialization_mode(self):
        if self.at < 0.0:
            os.kill(os.getpid(), signal.SIGINT)

    def do_step(self, current_time, step_size):
        if abs(current_time - self.at) < 0.5 * step_size:
            os.kill(os.getpid(), signal.SIGINT)
        self.clock = current_time + step_size
        return True
