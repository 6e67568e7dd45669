"""A parameter set as start values of the FMUs, by ``component.parameter``, and back."""

from __future__ import annotations

from collections.abc import Mapping

from ..control.commander import is_geometric
from ..control.feedforward import lowpass
from ..control.isolator import Isolator, is_known, known_payload
from ..cosim import System, Value
from ..disturbance import default_settings
from ..mechanism.flat import entries, taken_from
from ..mechanism.parameters import Parameters, load
from ..mechanism.plant import Plant

#: Start values of the isolator that are not of a parameter set.
IDEAL: dict[str, Value] = {f"isolator.{name}": 0.0 for name in ("delay", "sample_time", "force_limit")}


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


def plant_and_isolator(system: System) -> tuple[Plant, Isolator]:
    """What the start values of a system make of its plant and its isolator; what is not given is as in paper.toml.

    Raises
    ------
    ParameterError: an impossible value.
    """
    p = load()
    plant, isolator = (_given(system, component) for component in ("plant", "isolator"))
    filters = taken_from(p.filters, isolator, "filters")
    return (
        Plant(
            taken_from(p.manipulator, plant),
            taken_from(p.payload, plant, "payload"),
            taken_from(p.bus, plant, "bus"),
            taken_from(p.servo, plant, "servo"),
            taken_from(p.optics, plant, "optics"),
        ),
        Isolator(
            taken_from(p.manipulator, isolator),
            taken_from(known_payload(p), isolator, "payload"),
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
