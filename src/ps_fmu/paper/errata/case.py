"""The system on which the errata are computed: the paper's nominal one, at a pose without symmetry."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ...control.feedforward import Gains, gains
from ...mechanism.dynamics import Dynamics, Pose
from ...mechanism.inverse_kinematics import inverse_kinematics
from ...mechanism.parameters import Array, Parameters, load
from ...mechanism.rotations import rotation_matrix
from ...theory.transfer_matrices import Complex, Nominal, Practical
from ..bus_cases import assemble_nominal

ORIENTATION = np.radians([3.0, -4.0, 10.0])  # roll, pitch, yaw, rad
S: Complex = np.asarray(2j * np.pi * np.geomspace(0.05, 300.0, 40))  # rad/s, from below the modes of the bus upwards
SEED = 20230213


@cache
def parameters() -> Parameters:
    """The identified set on the original bus, whose modes have no damping: the paper's equations have none."""
    p = load()
    return replace(p, bus=replace(p.bus, modes=tuple(replace(mode, damping_ratio=0.0) for mode in p.bus.modes)))


@cache
def pose() -> Pose:
    """At :data:`ORIENTATION`, with the fine legs at nominal length."""
    found = inverse_kinematics(parameters().manipulator.geometry, ORIENTATION)
    return Pose(found.translation_B, rotation_matrix(ORIENTATION))


@cache
def dynamics() -> Dynamics:
    """Rigid rods and payload, modes of the bus."""
    return assemble_nominal(parameters(), pose())


@cache
def nominal() -> Nominal:
    """Transfer matrices by the equations of the paper, corrected."""
    return Nominal(dynamics())


@cache
def optimal_gains() -> Gains:
    """Of (52)-(54), for the payload as it is."""
    return gains(parameters().manipulator, parameters().payload, pose())


@cache
def plant() -> Practical:
    """The same by one solve of (25) with all coordinates: no U, no Y, no Schur complement."""
    return Practical(dynamics())


def following_matrix() -> Array:
    """Fine elongation per base motion with which the payload does not turn, ``J_thf^-1 J_thb``, (3, 6)."""
    J = dynamics().jacobians
    return np.asarray(np.linalg.solve(J.J_theta_f, J.J_theta_b))
