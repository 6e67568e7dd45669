"""Puts out what comes in, in all types of FMI 2.0; a height may be set before the initialisation."""

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String
from pythonfmu.enums import Fmi2Initial


class ToyRelay(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.real_in = 0.0
        self.level_in = 0.0
        self.whole_in = 1
        self.flag_in = False
        self.text_in = "none"
        self.gain = 1.0
        self.height = 5.0
        given, made = {"causality": Fmi2Causality.input}, {"causality": Fmi2Causality.output}
        discrete = {"variability": Fmi2Variability.discrete}
        self.register_variable(Real("real_in", **given))
        self.register_variable(Real("level_in", **given, **discrete))
        self.register_variable(Integer("whole_in", **given, **discrete))
        self.register_variable(Boolean("flag_in", **given, **discrete))
        self.register_variable(String("text_in", **given, **discrete))
        self.register_variable(Real("gain", causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed))
        self.register_variable(Real("height", **made, initial=Fmi2Initial.exact))
        self.register_variable(Real("real_out", **made, getter=lambda: self.gain * self.real_in))
        self.register_variable(Real("level_out", **made, getter=lambda: self.level_in))
        self.register_variable(Integer("whole_out", **made, **discrete, getter=lambda: self.whole_in))
        self.register_variable(Boolean("flag_out", **made, **discrete, getter=lambda: self.flag_in))
        self.register_variable(String("text_out", **made, **discrete, getter=lambda: self.text_in))

    def do_step(self, current_time, step_size):
        return True
