"""The cases of Figs 10 and 11: original or lighter support module (OSM, LSM), the paper's or larger damping (LD...)."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

from ..mechanism.parameters import Parameters, load
from ..mechanism.quantities import list_entries
from . import published

if TYPE_CHECKING:
    from ..cosim import Value

CASES = ("OSM", "LSM", "LDOSM", "LDLSM")
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
    p = parameters_of(case)
    bus = list_entries(p.bus, "bus")
    values: dict[str, Value] = {f"plant.{entry.name}": entry.value for entry in bus}
    values |= {f"disturbance.{entry.name}": entry.value for entry in bus if entry.name.startswith("bus.com.")}
    for i, leg in enumerate(p.manipulator.fine_legs, 1):
        values |= {f"{component}.fine_leg_{i}.damping": leg.damping for component in ("plant", "isolator")}
    return values
