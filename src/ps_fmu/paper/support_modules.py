"""The cases of Figs 10 and 11: original or lighter support module (OSM, LSM), the paper's or larger damping (LD...)."""

from __future__ import annotations

import re
from dataclasses import replace

from ..cosim import Value
from ..interface.parameter_sets import start_values
from ..mechanism.parameters import Parameters, load
from . import published

CASES = ("OSM", "LSM", "LDOSM", "LDLSM")
_DAMPING = re.compile(r"(plant|isolator)\.fine_leg_\d\.damping")
SUSPENSION = (2.0, 20.0)  # Hz: above the modes of the bus, below those of rods and truss


def parameters_of(case: str) -> Parameters:
    """The identified parameters of a case: the bus, and for LD... the larger damping of section 4.2."""
    p = load(bus=case[-3:])
    return with_large_damping(p) if case.startswith("LD") else p


def with_large_damping(p: Parameters) -> Parameters:
    """Parameters with the larger damping of section 4.2."""
    damping = published()["text.fine_damping_large"].value  # N.s/m
    legs = tuple(replace(leg, damping=damping) for leg in p.manipulator.fine_legs)
    return replace(p, manipulator=replace(p.manipulator, fine_legs=legs))


def values_of(case: str) -> dict[str, Value]:
    """Start values of the FMUs for a case, by ``component.parameter``: those of OSM.ssv, LSM.ssv, large_damping.ssv.

    The whole bus, also what is as in paper.toml and :func:`.parameter_sets.differences` would leave out: a case is
    that of the paper whatever bus and damping the user's parameter files have.
    """
    of_bus = ("plant.bus.", "disturbance.bus.com.")
    values = start_values(parameters_of(case))
    return {name: value for name, value in values.items() if name.startswith(of_bus) or _DAMPING.fullmatch(name)}
