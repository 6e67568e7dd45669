"""y = gain u; a chain of these shows the order of initialisation, a ring of them a loop."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class ToyGain(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.u = 1.0
        self.gain = 2.0
        self.latched = None
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        self.register_variable(Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed))
        self.register_variable(Real("y", causality=Fmi2Causality.output, getter=self.output))

    def output(self):
        return self.gain * self.u if self.latched is None else self.latched

    def do_step(self, current_time, step_size):
        self.latched = self.gain * self.u
        return True
