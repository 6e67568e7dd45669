"""The four cases of Figs 10 and 11: original or lighter support module (OSM, LSM), and both with larger damping (LD).

The support module is the ``bus`` of the parameters.  With them go the paper's nominal system, and what sections 3.2.2
and 4.2 compute with it.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..mechanism.dynamics import Dynamics, Pose, assemble
from ..mechanism.parameters import Array, Parameters, load
from ..theory import small_gain
from ..theory.transfer_matrices import Nominal, Practical
from .published import published_numbers

if TYPE_CHECKING:
    from ..cosim import Value

CASES = ("OSM", "LSM", "LDOSM", "LDLSM")
COLOURS = {"OSM": "#0072B2", "LSM": "#D55E00", "LDOSM": "#56B4E9", "LDLSM": "#E69F00"}  # Okabe and Ito
SUSPENSION = (2.0, 20.0)  # Hz: above the modes of the bus, below those of rods and truss


def load_case(case: str) -> Parameters:
    """The identified parameters of a case: its bus, and for LD... the larger damping of section 4.2."""
    p = load(bus=case[-3:])
    return with_large_damping(p) if case.startswith("LD") else p


def with_large_damping(p: Parameters) -> Parameters:
    """Parameters with the larger damping of the fine legs of section 4.2."""
    damping = published_numbers()["text.fine_damping_large"].value  # N.s/m
    legs = tuple(replace(leg, damping=damping) for leg in p.manipulator.fine_legs)
    return replace(p, manipulator=replace(p.manipulator, fine_legs=legs))


def case_start_values(case: str) -> dict[str, Value]:
    """Start values of the FMUs for a case, by ``component.parameter``: those of OSM.ssv, LSM.ssv, large_damping.ssv.

    The whole bus and the damping of the fine legs, also where they are those of paper.toml: a case is that of the
    paper, whatever bus and damping the user's parameter files set.
    """
    from ..interface.start_values import start_values

    return {
        name: value
        for name, value in start_values(load_case(case)).items()
        if ".bus." in name or (".fine_leg_" in name and name.endswith(".damping"))
    }


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
