"""Controller in place of PointingController: an integrator on the error of the line of sight.

The tracker measures the error. The voice coils turn the payload until the error is zero:

    force = stiffness * ELONGATION * 2 pi crossover * integral of error
"""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave, numbered, vector

# How much each fine leg grows when the payload turns about x, y, z of P: m/rad, of the paper's geometry.
ELONGATION = np.array([[-0.0808, -0.1971, -0.0707], [0.2111, 0.0286, -0.0707], [-0.1303, 0.1685, -0.0707]])


class Controller(Slave):
    model_description = "An integrator on the error of the line of sight"

    # Names decide: outputs and inputs of these names are wired, see `ps-fmu list LineOfSight.ssd 'pointing.*'`.
    ports = (
        *vector("line_of_sight_error", "xyz", "rad", "Rotation that leads to the target, in P", causality="input"),
        Port("locked", "input", type="Boolean", start=False, description="The tracker measures the error"),
        # The scenarios switch the loop off in the case `passive`.
        Port("enabled", "input", type="Boolean", start=True, description="False: no force"),
        *numbered("fine_force", 3, "N", "Force of a voice coil, positive extends the leg", causality="output"),
        Port("crossover", "parameter", "Hz", "Below it the loop acts", start=0.2, min=0.001, max=0.5),
        Port("stiffness", "parameter", "N/m", "Stiffness of a fine leg", start=32051.8, min=0.0),
    )
    n_states = 3  # the integral of the error about x, y, z

    def step_map(self, h):
        """The matrix of a step of h (s): [outputs; states] at its end from [states; inputs] at its start."""
        if not self.value("enabled"):
            return np.zeros((6, 6))
        gain = self.value("stiffness") * ELONGATION * 2 * np.pi * self.value("crossover")
        kept = np.eye(3) * [True, True, False]  # a tracker does not measure the roll about z
        seen = h * kept if self.value("locked") else np.zeros((3, 3))
        return np.vstack([np.hstack([gain, np.zeros((3, 3))]), np.hstack([np.eye(3), seen])])

    def event(self, t, h):
        """An input that is not Real has changed: ask for the matrix again."""
        self.remap()
        return False
