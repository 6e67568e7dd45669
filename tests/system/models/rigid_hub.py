"""RigidHub: a host's spacecraft in an FMU of pythonfmu, for the master: small motion of a body that carries another."""

import numpy as np
from pythonfmu import Fmi2Causality, Fmi2Slave, Real

AXES, PAIRS = "xyz", ("xx", "xy", "xz", "yy", "yz", "zz")
INPUTS = [f"{kind}_{axis}" for kind in ("force", "torque", "bus_force", "bus_torque") for axis in AXES]
INPUTS += ["locked_mass", *(f"locked_com_{axis}" for axis in AXES), *(f"locked_inertia_{pair}" for pair in PAIRS)]
OUTPUTS = [f"{kind}_{axis}" for kind in ("acceleration", "angular_acceleration", "angular_velocity") for axis in AXES]
OWN = {"mass": 60.0, "com_z": 0.0, "inertia": 1.0}  # kg, m, kg.m2: a cube, inertia about its centre of mass


def mass_matrix(mass, com, inertia):
    """(6, 6) of a rigid body; inertia (3, 3) about the origin."""
    x, y, z = mass * com
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.block([[mass * np.eye(3), -across], [across, inertia]])


class RigidHub(Fmi2Slave):
    """Hub and locked mass as one body, pushed by what acts from outside and by the mechanism's reaction."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        for names, causality in ((INPUTS, "input"), (OUTPUTS, "output"), (OWN, "parameter")):
            for name in names:
                setattr(self, name, OWN.get(name, 0.0))
                self.register_variable(Real(name, causality=Fmi2Causality[causality]))
        self.rate = np.zeros(3)

    def do_step(self, current_time, step_size):
        values = np.array([getattr(self, name) for name in INPUTS])
        wrench, reaction, mass, com = values[:6], values[6:12], values[12], values[13:16]
        locked = np.zeros((3, 3))
        locked[np.triu_indices(3)] = values[16:]
        locked += np.triu(locked, 1).T
        own_com = np.array([0.0, 0.0, self.com_z])
        about_origin = self.inertia * np.eye(3) + self.mass * (self.com_z**2) * np.diag([1.0, 1.0, 0.0])
        whole = mass_matrix(self.mass, own_com, about_origin) + mass_matrix(mass, com, locked)
        acceleration = np.linalg.solve(whole, wrench + reaction)
        middle = self.rate + 0.5 * step_size * acceleration[3:]
        self.rate = self.rate + step_size * acceleration[3:]
        for name, value in zip(OUTPUTS, (*acceleration, *middle), strict=True):
            setattr(self, name, float(value))
        return True
