"""
Your own controller against the plant FMU
=========================================

The plant is an FMU like any other. Here FMPy steps it together with the disturbance source, and
a controller of twenty lines of numpy closes a loop between them: it measures the rotation of
the payload and turns it back with the fine legs.
"""

# %%
# Load two FMUs
# -------------
#
# FMPy's ``FMU2Slave`` is the plain FMI interface. A small class keeps instance and value
# references together.

import shutil

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Slave

from ps_fmu.runs.built_fmus import find_built_folder

STEP = 1e-3  # s


class Component:
    """An instance of an FMU whose variables are read and written by name."""

    def __init__(self, name, start=None):
        path = find_built_folder() / f"{name}.fmu"
        self.folder = extract(path)
        description = read_model_description(path)
        self.places = {
            variable.name: variable.valueReference for variable in description.modelVariables
        }
        self.fmu = FMU2Slave(
            guid=description.guid,
            unzipDirectory=self.folder,
            modelIdentifier=description.coSimulation.modelIdentifier,
            instanceName=name,
        )
        self.fmu.instantiate()
        self.set(start or {})
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, values):
        self.fmu.setReal([self.places[name] for name in values], list(values.values()))

    def get(self, names):
        return np.array(self.fmu.getReal([self.places[name] for name in names]))

    def step(self, time):
        self.fmu.doStep(currentCommunicationPoint=time, communicationStepSize=STEP)

    def close(self):
        self.fmu.terminate()
        self.fmu.freeInstance()
        shutil.rmtree(self.folder)


# %%
# Know the plant
# --------------
#
# Names of FMU variables are dotted: ``payload_rotation.x``. What does 1 N in each fine leg do
# to the rotation of the payload? A run for each leg tells, with well damped legs that settle
# within a second.

WRENCH = [f"base_{kind}.{axis}" for kind in ("force", "torque") for axis in "xyz"]
ROTATION = [f"payload_rotation.{axis}" for axis in "xyz"]
FORCES = [f"fine_force_{leg}" for leg in (1, 2, 3)]
VELOCITIES = [f"fine_velocity_{leg}" for leg in (1, 2, 3)]


def measure_gain():
    """Rotation of the payload (x, y, z in P) by each fine force, (3, 3), rad/N."""
    columns = []
    for force in FORCES:
        plant = Component(
            "ManipulatorPlant", {f"fine_leg_{leg}.damping": 900.0 for leg in (1, 2, 3)}
        )
        plant.set({force: 1.0})
        for k in range(1000):
            plant.step(k * STEP)
        columns.append(plant.get(ROTATION))
        plant.close()
    return np.array(columns).T


gain = measure_gain()
print("urad per N:")
print(1e6 * gain.round(8))

# %%
# The controller
# --------------
#
# Two parts. The legs' suspension at 5.35 Hz has hardly any damping, so a force against the
# speed of each leg comes first. On top of it a loop turns the payload back:
#
# .. math::
#
#    f = - c \, \dot{d}_\text{f} - G^{-1} w , \qquad
#    w(s) = \omega_\text{c} \frac{s + \omega_\text{i}}{s^2} \, \theta(s)
#
# with :math:`G` the gain from above, :math:`\theta` the rotation, a crossover of 1 Hz, and
# integration twice below 0.2 Hz.


class Controller:
    """Damping of the legs, and a loop on the rotation."""

    def __init__(self, gain, crossover=1.0, corner=0.2, damping=900.0):  # rad/N, Hz, Hz, N.s/m
        self.inverse = np.linalg.inv(gain)
        self.crossover, self.corner, self.damping = (
            2 * np.pi * crossover,
            2 * np.pi * corner,
            damping,
        )
        self.first, self.second = np.zeros(3), np.zeros(3)

    def force(self, rotation, velocity):
        """Fine forces (3,), N, from the payload's rotation (3,), rad, and the legs' velocities (3,), m/s."""
        self.first += STEP * rotation
        self.second += STEP * self.first
        demand = self.crossover * (self.first + self.corner * self.second)
        return -self.damping * velocity - self.inverse @ demand


# %%
# Close the loop
# --------------
#
# Each step: read the plant, compute the force, step all. Outputs of these FMUs are latched at
# the end of a step, so the order within a step does not matter, and there is no algebraic loop.
# A step of 1 ms samples at 1 kHz: the noise has to end below 400 Hz, otherwise it folds to low
# frequencies, of which the FMU would warn.


def simulate(controller, seconds=12.0):
    """The payload's rotation after each step, (n, 3), rad."""
    plant = Component("ManipulatorPlant")
    source = Component("DisturbanceSource", {"noise.band.max": 400.0})
    record = np.empty((round(seconds / STEP), 3))
    for k in range(len(record)):
        plant.set(dict(zip(WRENCH, source.get(WRENCH), strict=True)))
        if controller is not None:
            force = controller.force(plant.get(ROTATION), plant.get(VELOCITIES))
            plant.set(dict(zip(FORCES, force, strict=True)))
        plant.step(k * STEP)
        source.step(k * STEP)
        record[k] = plant.get(ROTATION)
    plant.close()
    source.close()
    return record


free = simulate(None)
held = simulate(Controller(gain))
settled = round(2.0 / STEP)
rms = {name: record[settled:].std(axis=0) for name, record in (("free", free), ("held", held))}
for k, axis in enumerate("xyz"):
    print(
        f"{axis}: {1e6 * rms['free'][k]:6.2f} urad without, {1e6 * rms['held'][k]:5.2f} urad with the controller"
    )

# %%

import matplotlib.pyplot as plt

time = STEP * np.arange(1, len(free) + 1)
figure, rows = plt.subplots(3, 1, figsize=(8, 6), sharex=True, layout="constrained")
for k, row in enumerate(rows):
    row.plot(time, 1e6 * free[:, k], label="no controller", linewidth=0.8)
    row.plot(time, 1e6 * held[:, k], label="own controller", linewidth=0.8)
    row.set_ylabel(f"{'xyz'[k]} (urad)")
    row.grid(True, alpha=0.3)
rows[0].legend(loc="upper right")
rows[0].set_title("Payload rotation")
rows[-1].set_xlabel("time (s)")

# %%
# The loop takes away the slow motion of the bus. Above its crossover it can do little; there
# the feedforward isolator, which measures the acceleration of the base, is the better half:
# connect ``FeedforwardIsolator.fmu`` beside it, and give your force to the plant's
# ``added_fine_force_1`` to ``_3``. To share the frequencies between the two, see the page of
# ``PointingController``.
