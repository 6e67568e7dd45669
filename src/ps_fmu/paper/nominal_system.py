"""The paper's nominal system, and what sections 3.2.2 and 4.2 compute with it."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from ..mechanism.dynamics import Dynamics, Pose, assemble
from ..mechanism.parameters import Array, Parameters
from ..theory import small_gain
from ..theory.transfer_matrices import Nominal, Practical
from .bus_cases import load_case


def assemble_nominal(p: Parameters, pose: Pose | None = None) -> Dynamics:
    """The nominal system: rigid rods and payload, modes of the bus with damping; by default at the nominal pose."""
    manipulator = replace(p.manipulator, coarse_rods=replace(p.manipulator.coarse_rods, axial_stiffness=0.0))
    pose = pose or Pose(p.manipulator.geometry.nominal_translation_B, np.eye(3))
    return assemble(manipulator, replace(p.payload, truss_modes=()), p.bus, pose)


@cache
def mobile_base_factors(case: str) -> tuple[float, float]:
    """Mobile-base factor v (41) of a case, and its estimate (42)."""
    system = assemble_nominal(load_case(case))
    return Practical(system).mobile_base_factor(), Nominal(system).mobile_base_estimate()


def small_gain_curves(case: str, frequency: Array, delay: float) -> tuple[Array, Array]:
    """Left-hand side of (62), with T by (63) and with its bound (64), each (n,), over frequency (n,), Hz.

    Delta is that of the delay (s) alone; the modes of the bus have the damping of the parameter set.
    """
    nominal, s = Practical(assemble_nominal(load_case(case))), 2j * np.pi * np.asarray(frequency)
    uncertainty = small_gain.delay_uncertainty(frequency, delay)
    T = small_gain.largest_singular_value(small_gain.nominal_complement(nominal, s))
    return np.asarray(T * uncertainty), np.asarray(small_gain.nominal_complement_bound(nominal, s) * uncertainty)
