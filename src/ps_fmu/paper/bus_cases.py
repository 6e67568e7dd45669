"""The four cases of Figs 10 and 11: original or lighter support module (OSM, LSM), and both with larger damping (LD).

The support module is the ``bus`` of the parameters.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..mechanism.parameters import Parameters, load
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
    from ..interface.parameter_sets import start_values

    return {
        name: value
        for name, value in start_values(load_case(case)).items()
        if ".bus." in name or (".fine_leg_" in name and name.endswith(".damping"))
    }
