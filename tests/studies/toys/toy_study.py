"""A pointing error that depends on its parameters and its seed, and every way in which a case can go wrong."""

import ctypes
import math
import os
import random
import time

from pythonfmu import Boolean, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real, String


class ToyStudy(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.gain = 1.0
        self.offset = 0.0
        self.slowness = 0.0
        self.seed = 1
        self.mode = "none"
        self.limit = 0.0
        self.once = ""
        self.gate = ""
        self.held = 0.0
        self.x = 0.0
        self.y = 0.0
        self.large = False
        self.u = 0.0
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        for name in ("gain", "offset", "slowness", "limit", "held"):
            self.register_variable(Real(name, **fixed))
        self.register_variable(Integer("seed", **fixed))
        self.register_variable(String("mode", **fixed))
        self.register_variable(String("once", **fixed))
        self.register_variable(String("gate", **fixed))
        self.register_variable(Real("u", causality=Fmi2Causality.input))
        for name in ("x", "y"):
            self.register_variable(
                Real(f"error.{name}", causality=Fmi2Causality.output, getter=lambda name=name: getattr(self, name))
            )
        discrete = {"variability": Fmi2Variability.discrete}
        self.register_variable(Boolean("large", causality=Fmi2Causality.output, **discrete))

    def exit_initialization_mode(self):
        self.random = random.Random(self.seed)

    def do_step(self, current_time, step_size):
        if self.once and not os.path.exists(self.once):
            open(self.once, "w").close()
            os._exit(9)
        while self.gate and self.gain == self.held and os.path.exists(self.gate):
            time.sleep(0.02)
        if self.mode != "none" and current_time > 0.05 and self.gain > self.limit:
            self.break_down()
        time.sleep(self.slowness)
        self.x = self.gain * self.random.gauss(0.0, 1.0)
        self.y = self.gain**2 * self.random.gauss(0.0, 1.0) + self.offset
        self.large = abs(self.x) > 2.0
        return True

    def break_down(self):
        if self.mode == "raise":
            raise RuntimeError("the model broke")
        if self.mode == "nan":
            self.gain = math.nan
        if self.mode == "exit":
            print("about to leave", flush=True)
            os._exit(3)
        if self.mode == "end":
            os._exit(0)
        if self.mode == "crash":
            ctypes.string_at(0)
        if self.mode == "hang":
            time.sleep(1000.0)
        if self.mode == "eat":
            self.eaten = [bytearray(50_000_000) for _ in range(40)]
            time.sleep(1000.0)
