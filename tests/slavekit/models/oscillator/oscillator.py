"""Toy: a mass on a spring whose rest position glides to a reference; has every kind of variable."""

import numpy as np

from ps_fmu.slavekit.author.slave import ModelError, Port, Slave

GLIDE = 0.1  # m per step: how far the rest position moves at most


class Oscillator(Slave):
    model_description = "A mass on a spring"
    ports = (
        Port("position", "output", "m", "Position of the mass", nominal=0.5),
        Port("speed", "output", "m/s", "Speed of the mass"),
        Port("engaged", "output", type="Boolean", description="Does the spring follow the reference?"),
        Port("force", "input", "N", "Force on the mass", min=-100.0, max=100.0),
        Port("load", "input", "N", "Another force on the mass"),
        Port("reference", "input", "m", "Where the rest position goes", event=True),
        Port("engage", "input", type="Boolean", start=True, description="Follow the reference"),
        Port("mass", "parameter", "kg", "Mass", start=2.0, min=0.1),
        Port("stiffness", "parameter", "N/m", "Stiffness", start=8.0, min=0.0),
        Port("start.position", "parameter", "m", "Position at the start", start=0.1),
        Port("substeps", "parameter", type="Integer", start=1, min=1, max=100, description="Steps within a step"),
        Port("note", "parameter", type="String", start="a toy", description="Remark"),
    )
    n_states = 2  # position, speed
    n_auxiliary = 2  # rest position, engaged
    n_memory = 1  # number of events

    def configure(self) -> None:
        if self.value("note") == "impossible":
            raise ModelError("note: 'impossible' is not possible")
        self.x[:] = self.value("start.position"), 0.0
        self.a[:] = self.value("reference"), self.value("engage")
        self.memory[0] = 0.0

    def output_map(self):
        return np.array([[1.0, 0, 0, 0, 0, 0], [0, 1.0, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1.0]])

    def step_map(self, h):
        self.maps_made = getattr(self, "maps_made", 0) + 1
        mass, stiffness, n = self.value("mass"), self.value("stiffness"), self.value("substeps")
        k = h / n
        speed = np.array([-stiffness * k / mass, 1.0, k / mass, k / mass, stiffness * k / mass, 0.0])
        position = np.array([1.0, 0, 0, 0, 0, 0]) + k * speed
        once = np.vstack([position, speed, np.eye(6)[2:]])
        total = np.linalg.matrix_power(once, n)
        return np.vstack([total[:2], np.eye(6)[5], total[:2]])

    def event(self, t, h):
        self.memory[0] += 1.0
        self.event_times = [*getattr(self, "event_times", []), t]
        target = self.value("reference") if self.value("engage") else 0.0
        self.a[0] += np.clip(target - self.a[0], -GLIDE, GLIDE)
        self.a[1] = self.value("engage")
        self.remap()
        if target > 1.0:
            raise ModelError(f"reference = {target} m: expected at most 1 m")
        return bool(self.a[0] != target)
