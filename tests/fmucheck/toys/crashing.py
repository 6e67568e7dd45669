"""Takes its host along in the third step."""

import os
import signal

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Crashing(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.y += 1.0
        if self.y == 3.0:
            os.kill(os.getpid(), signal.SIGKILL)
        return True
