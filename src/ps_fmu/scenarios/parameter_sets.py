"""A parameter set as start values of the FMUs, by ``component.parameter``."""

from __future__ import annotations

from ..cosim import Value
from ..manipulator.commander import is_geometric
from ..manipulator.disturbance import default_settings
from ..manipulator.flat import entries
from ..manipulator.isolator import is_known, known_payload
from ..manipulator.parameters import Parameters, load


def start_values(p: Parameters) -> dict[str, Value]:
    """What a parameter set says of plant, isolator, commander and disturbance source."""
    components = {
        "plant": [
            *entries(p.manipulator),
            *entries(p.payload, "payload"),
            *entries(p.bus, "bus"),
            *entries(p.servo, "servo"),
            *entries(p.optics, "optics"),
        ],
        "isolator": [
            *entries(p.manipulator, keep=is_known),
            *entries(known_payload(p), "payload", keep=is_known),
            *entries(p.filters, "filters"),
        ],
        "commander": entries(p.manipulator, keep=is_geometric),
        "disturbance": entries(default_settings(p)),
    }
    return {f"{component}.{entry.name}": entry.value for component, found in components.items() for entry in found}


def differences(p: Parameters) -> dict[str, Value]:
    """The start values that are not those of paper.toml."""
    paper = start_values(load())
    return {name: value for name, value in start_values(p).items() if value != paper[name]}
