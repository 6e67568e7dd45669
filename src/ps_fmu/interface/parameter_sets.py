"""A parameter set as start values of the FMUs, by ``component.parameter``, and back."""

from __future__ import annotations

from collections.abc import Mapping

from ..control.commander import is_geometric
from ..control.feedforward import lowpass
from ..control.isolator import Isolator, is_known, known_payload
from ..cosim import System, Value
from ..disturbance import default_settings
from ..mechanism.linear_model import Plant
from ..mechanism.parameters import Parameters, load
from ..mechanism.quantities import list_entries, take_values

#: Start values of the isolator that are not of a parameter set.
IDEAL: dict[str, Value] = {f"isolator.{name}": 0.0 for name in ("delay", "sample_time", "force_limit")}


def start_values(p: Parameters) -> dict[str, Value]:
    """What a parameter set says of plant, isolator, commander and disturbance source."""
    components = {
        "plant": [
            *list_entries(p.manipulator),
            *list_entries(p.payload, "payload"),
            *list_entries(p.bus, "bus"),
            *list_entries(p.servo, "servo"),
            *list_entries(p.optics, "optics"),
        ],
        "isolator": [
            *list_entries(p.manipulator, keep=is_known),
            *list_entries(known_payload(p), "payload", keep=is_known),
            *list_entries(p.filters, "filters"),
        ],
        "commander": list_entries(p.manipulator, keep=is_geometric),
        "disturbance": list_entries(default_settings(p)),
    }
    return {f"{component}.{entry.name}": entry.value for component, found in components.items() for entry in found}


def differences(p: Parameters) -> dict[str, Value]:
    """The start values that are not those of paper.toml."""
    paper = start_values(load())
    return {name: value for name, value in start_values(p).items() if value != paper[name]}


def plant_and_isolator(system: System) -> tuple[Plant, Isolator]:
    """What the start values of a system make of its plant and its isolator; what is not given is as in paper.toml.

    Raises
    ------
    ParameterError: an impossible value.
    """
    p = load()
    plant, isolator = (_given(system, component) for component in ("plant", "isolator"))
    filters = take_values(p.filters, isolator, "filters")
    return (
        Plant(
            take_values(p.manipulator, plant),
            take_values(p.payload, plant, "payload"),
            take_values(p.bus, plant, "bus"),
            take_values(p.servo, plant, "servo"),
            take_values(p.optics, plant, "optics"),
        ),
        Isolator(
            take_values(p.manipulator, isolator),
            take_values(known_payload(p), isolator, "payload"),
            filters,
            lowpass(filters),
        ),
    )


def not_of_the_paper(given: Mapping[str, Value]) -> list[str]:
    """Names of the start values that make another system than that of paper.toml with an ideal isolator."""
    paper = start_values(load()) | IDEAL
    return [name for name, value in given.items() if paper.get(name, value) != value]


def _given(system: System, component: str) -> dict[str, Value]:
    return {name: entry.value for name, entry in system.component(component).parameters.items()}
