"""Plant, controller and their loop as python-control systems with named signals: for design, margins and responses.

Signal names are those of the FMU ports with ``_`` for the dot, which python-control does not allow in a name.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..control.feedforward import Controller
from ..mechanism.linear_model import PlantModel
from ..mechanism.signals import N_INPUTS, N_LOADS, OUTPUTS

if TYPE_CHECKING:
    from control import StateSpace

FINE_FORCES = [f"fine_force_{i}" for i in (1, 2, 3)]  # N
BASE_WRENCH = [f"base_{kind}_{axis}" for kind in ("force", "torque") for axis in "xyz"]  # N, N.m, in B at its origin
OUTPUT_NAMES = [name.replace(".", "_") for signal in OUTPUTS for name in signal.names]
BASE_ACCELERATION = OUTPUT_NAMES[:6]


def plant_system(model: PlantModel) -> StateSpace:
    """The plant about its pose, coarse legs at rest: from fine forces and base wrench (9) to all its outputs.

    Orientation and coarse displacement are deviations from the pose.  Coordinates that are switched off are left out.
    """
    from control import ss

    A, B, C, D = model.matrices()
    d = model.dynamics
    moving = np.concatenate([d.active, d.active, np.zeros(model.n_states - 2 * d.n, dtype=bool)])
    inputs = np.arange(N_INPUTS) < N_LOADS
    return ss(
        A[np.ix_(moving, moving)],
        B[np.ix_(moving, inputs)],
        C[:, moving],
        D[:, inputs],
        inputs=FINE_FORCES + BASE_WRENCH,
        outputs=OUTPUT_NAMES,
        name="plant",
    )


def controller_system(controller: Controller) -> StateSpace:
    """The practical controller (55): from base acceleration (6) to fine forces (3)."""
    from control import ss

    return ss(*controller.matrices(), inputs=BASE_ACCELERATION, outputs=FINE_FORCES, name="isolator")


def closed_loop(model: PlantModel, controller: Controller) -> StateSpace:
    """Plant and isolator together: from base wrench (6) to the plant's outputs, in continuous time without delay."""
    from control import interconnect, ss

    plant, isolator = plant_system(model), controller_system(controller)
    # The wrench comes from outside under its own name; everything else is matched by name.
    return ss(
        interconnect(
            [plant, isolator],
            connections=[[f"isolator.{name}", f"plant.{name}"] for name in BASE_ACCELERATION]
            + [[f"plant.{name}", f"isolator.{name}"] for name in FINE_FORCES],
            inplist=[f"plant.{name}" for name in BASE_WRENCH],
            inputs=BASE_WRENCH,
            outlist=[f"plant.{name}" for name in OUTPUT_NAMES],
            outputs=OUTPUT_NAMES,
            name="closed_loop",
        )
    )
