"""Says that its state can be saved, and keeps a part of it where nobody looks."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Real


class Forgetful(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.y = 0.0
        self.hidden = 0.0
        self.register_variable(Real("y", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.hidden += 1.0
        self.y = self.hidden
        return True
