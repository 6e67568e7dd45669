"""Boolean, Integer and String variables: counts while enabled, toggles a Boolean every step."""

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class ToyCounter(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.enabled = True
        self.increment = 1
        self.label = "none"
        self.count = 0
        self.odd = False
        self.half = 0.0
        discrete = {"variability": Fmi2Variability.discrete}
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        self.register_variable(Boolean("enabled", causality=Fmi2Causality.input, **discrete))
        self.register_variable(Integer("increment", causality=Fmi2Causality.input, **discrete))
        self.register_variable(String("label", **fixed))
        self.register_variable(Integer("count", causality=Fmi2Causality.output, **discrete))
        self.register_variable(Boolean("odd", causality=Fmi2Causality.output, **discrete))
        self.register_variable(Real("half", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        if self.enabled:
            self.count += self.increment
        self.odd = self.count % 2 == 1
        self.half = self.count / 2.0
        return True
