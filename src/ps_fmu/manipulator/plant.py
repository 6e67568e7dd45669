"""The plant over a slew: a linear model about a pose, replaced by one about the next pose when the legs have moved.

Between poses everything is linear (:class:`.practical.PlantModel`).  What is not linear happens here: the rate
limit of the coarse servos, the stroke, and the choice of a new pose.  Nothing here knows of FMI.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .dynamics import Pose, assemble
from .forward import forward_kinematics
from .parameters import Bus, CoarseServo, Manipulator, Optics, Payload
from .practical import PlantModel, carry_over

Array = NDArray[np.float64]

#: A servo is at rest when it is this close to its reference (m) and this slow (m/s): far below any optical effect.
AT_REST = 1e-12


@dataclass(frozen=True, eq=False)
class Plant:
    """The system whose plant models are asked for."""

    manipulator: Manipulator
    payload: Payload
    bus: Bus
    servo: CoarseServo
    optics: Optics

    def linearise(self, coarse_displacement: Array) -> PlantModel:
        """The model about the pose of given coarse displacements (3,), m, with the fine legs at their nominal length.

        Newton's iteration always starts from the nominal pose, so that the same displacements give the same bits
        whatever came before: a restored FMU state continues exactly.

        Raises
        ------
        ForwardKinematicsError: no pose has these leg lengths.
        """
        geometry = self.manipulator.geometry
        lengths = geometry.nominal_lengths.copy()
        lengths[:3] += coarse_displacement
        found = forward_kinematics(geometry, lengths)
        dynamics = assemble(self.manipulator, self.payload, self.bus, Pose(found.translation_B, found.R))
        return PlantModel(dynamics, self.servo, self.optics, np.array(coarse_displacement), found.orientation)

    def within_stroke(self, command: Array) -> Array:
        """The command (3,), m, with each leg kept within its stroke."""
        low, high = self.manipulator.coarse_stroke
        return np.clip(command, low, high)

    def initial_state(self, model: PlantModel) -> Array:
        """Everything at rest at the pose of ``model``."""
        x = np.zeros(model.n_states)
        x[2 * model.dynamics.n : 2 * model.dynamics.n + 3] = model.coarse_reference
        return x


@dataclass(frozen=True, eq=False)
class CoarseMotion:
    """What a step of moving coarse legs asks for."""

    reference: Array  # (3,) rate-limited reference for the servos, m
    state: Array  # (n,) state of the plant, about the pose of ``model``
    model: PlantModel  # the same as before, or one about a new pose
    moving: bool  # ask again before the next step


def coarse_motion(
    plant: Plant, model: PlantModel, x: Array, reference: Array, command: Array, h: float, resolution: float
) -> CoarseMotion:
    """Advance the servos' reference by one step and choose the pose to linearise about.

    Parameters
    ----------
    x: state of ``model``.  reference: (3,) reference of the last step, m.  command: (3,) within the stroke, m.
    h: step, s.  resolution: largest distance of a leg from the pose of the model, m.

    Raises
    ------
    ForwardKinematicsError: the legs have reached lengths that no pose has.
    """
    furthest = plant.servo.rate_limit * h
    gap = command - reference
    reference = np.where(np.abs(gap) <= furthest, command, reference + np.clip(gap, -furthest, furthest))
    n = model.dynamics.n
    s, ds = x[2 * n : 2 * n + 3], x[2 * n + 3 :]
    arrived = bool((reference == command).all())
    at_rest = arrived and max(np.abs(s - command).max(), np.abs(ds).max()) < AT_REST
    if at_rest:  # exactly there: the final pose is the commanded one, not one within the resolution
        x = x.copy()
        x[2 * n : 2 * n + 3], x[2 * n + 3 :] = command, 0.0
        s = x[2 * n : 2 * n + 3]
    distance = np.abs(s - model.coarse_reference).max()
    if distance > resolution or (at_rest and distance > 0.0):
        new = plant.linearise(s)
        x = carry_over(model.dynamics, new.dynamics, x)
        model = new
    return CoarseMotion(reference, x, model, moving=not at_rest)
