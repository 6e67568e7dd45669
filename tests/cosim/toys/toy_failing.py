"""A clock that fails at a given time: by an exception, by refusing the step, or with a NaN; or it warns."""

from pythonfmu import Fmi2Causality, Fmi2Slave, Fmi2Variability, Real, String
from pythonfmu.enums import Fmi2Status


class ToyFailing(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.mode = "none"
        self.at = 0.05
        self.clock = 0.0
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        self.register_variable(String("mode", **fixed))
        self.register_variable(Real("at", **fixed))
        self.register_variable(Real("clock", causality=Fmi2Causality.output))

    def do_step(self, current_time, step_size):
        self.clock = current_time + step_size
        if current_time > self.at - 0.5 * step_size:
            if self.mode == "exception":
                raise RuntimeError("the model broke")
            if self.mode == "discard":
                self.log("cannot go on", Fmi2Status.discard)
                return False
            if self.mode == "nan":
                self.clock = float("nan")
            if self.mode == "warn":
                self.log("getting warm", Fmi2Status.warning)
        return True
