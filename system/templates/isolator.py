"""Isolator in place of FeedforwardIsolator: a loop on the rotation of the payload, and damping of the fine legs.

A gyroscope on the payload measures the rotation. The loop integrates it twice and turns the payload back with the voice
coils; the rate of each leg damps the resonance of the suspension:

    w     = 2 pi crossover * (integral + 2 pi integral_frequency * double integral of the rotation)
    force = -stiffness * ELONGATION * w - damping * rate of the leg
"""

import numpy as np

from ps_fmu.slavekit.author.slave import Port, Slave, numbered, vector

# How much each fine leg grows when the payload turns about x, y, z of P: m/rad, of the paper's geometry.
ELONGATION = np.array([[-0.0808, -0.1971, -0.0707], [0.2111, 0.0286, -0.0707], [-0.1303, 0.1685, -0.0707]])


class Isolator(Slave):
    model_description = "A loop on the rotation of the payload, and damping of the fine legs"

    # An input gets the signal of its name, see `ps-fmu list isolation 'plant.*'`.  All units are SI.
    ports = (
        *vector("payload_rotation", "xyz", "rad", "Rotation of the payload, in P", causality="input"),
        *numbered("fine_velocity", 3, "m/s", "Rate of elongation of a fine leg", causality="input"),
        # The scenarios switch the isolator off in the case `passive`.
        Port("enabled", "input", type="Boolean", start=True, description="False: no force"),
        *numbered("fine_force", 3, "N", "Force of a voice coil, positive extends the leg", causality="output"),
        Port("crossover", "parameter", "Hz", "Above it the loop does little", start=1.0, min=0.01, max=3.0),
        Port("integral_frequency", "parameter", "Hz", "Below it the loop integrates twice", start=0.2, min=0.0),
        Port("stiffness", "parameter", "N/m", "Stiffness of a fine leg", start=32051.8, min=0.0),
        Port("damping", "parameter", "N.s/m", "Damping that is added to a leg", start=900.0, min=0.0),
    )
    n_states = 6  # the integral and the double integral of the rotation about x, y, z

    def step_map(self, h):
        """The matrix of a step of h (s): [outputs; states] at its end from [states; inputs] at its start."""
        matrix = np.zeros((3 + 6, 6 + 6))
        if not self.value("enabled"):
            return matrix  # no force, and the integrals begin at zero
        force, once, twice = matrix[:3], matrix[3:6], matrix[6:]
        integral, double, rotation, rate = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 12)
        once[:, integral] = twice[:, double] = np.eye(3)
        once[:, rotation] = twice[:, integral] = h * np.eye(3)
        gain = -self.value("stiffness") * ELONGATION * 2 * np.pi * self.value("crossover")
        force[:, integral] = gain
        force[:, double] = gain * 2 * np.pi * self.value("integral_frequency")
        force[:, rate] = -self.value("damping") * np.eye(3)
        return matrix

    def event(self, t, h):
        """An input that is not Real has changed: ask for the matrix again."""
        self.remap()
        return False
