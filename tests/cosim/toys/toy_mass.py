"""Oscillator, first half: a mass under a force, semi-implicit Euler."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real


class ToyMass(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.force = 0.0
        self.mass = 2.0
        self.position = 1.0
        self.velocity = 0.0
        parameter = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.tunable}
        self.register_variable(Real("force", causality=Fmi2Causality.input))
        self.register_variable(Real("mass", **parameter))
        self.register_variable(Real("position", causality=Fmi2Causality.output))
        self.register_variable(Real("velocity", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.velocity += step_size * self.force / self.mass
        self.position += step_size * self.velocity
        return True
