"""Oscillator, second half: spring and damper; outputs latched at the end of a step, direct before."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class ToySpring(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.position = 0.0
        self.velocity = 0.0
        self.stiffness = 8.0
        self.damping = 0.5
        self.latched = None
        parameter = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        self.register_variable(Real("position", causality=Fmi2Causality.input))
        self.register_variable(Real("velocity", causality=Fmi2Causality.input))
        self.register_variable(Real("stiffness", **parameter))
        self.register_variable(Real("damping", **parameter))
        self.register_variable(Real("force", causality=Fmi2Causality.output, getter=self.output))

    def law(self):
        return -self.stiffness * self.position - self.damping * self.velocity

    def output(self):
        return self.law() if self.latched is None else self.latched

    def do_step(self, current_time, step_size):
        self.latched = self.law()
        return True
