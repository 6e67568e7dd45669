"""A parameter set as start values of the four FMUs of the paper's system, by ``component.parameter``, and back.

:mod:`.system_values` does so for the components of any system.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

from ..control.commander import Commander, is_geometric
from ..control.isolator import Isolator
from ..cosim import System, Value
from ..disturbance import default_settings
from ..mechanism.linear_model import Plant
from ..mechanism.modes import BusMode, TrussMode
from ..mechanism.parameters import Parameters, load
from ..mechanism.quantities import ParameterError, list_entries, take_values

M = TypeVar("M", BusMode, TrussMode)

#: Start values of the isolator that are not of a parameter set.
IDEAL: dict[str, Value] = {f"isolator.{name}": 0.0 for name in ("delay", "sample_time", "force_limit")}


def fit_modes(p: Parameters) -> Parameters:
    """The parameter set with as many modes as the FMUs hold: unused ones take the places that are left.

    Raises
    ------
    ParameterError: more modes than the FMUs hold; the text names them and the number that fits.
    """
    places = load()
    truss = _fit("payload.truss_modes", p.payload.truss_modes, places.payload.truss_modes)
    modes = _fit("bus.modes", p.bus.modes, places.bus.modes)
    return replace(p, payload=replace(p.payload, truss_modes=truss), bus=replace(p.bus, modes=modes))


def _fit(name: str, modes: tuple[M, ...], places: tuple[M, ...]) -> tuple[M, ...]:
    if len(modes) > len(places):
        raise ParameterError(
            name,
            f"{len(modes)} modes, but the FMU of the plant holds {len(places)}: leave out those that matter least, "
            "for example by their participation",
        )
    return modes + tuple(type(place).unused() for place in places[len(modes) :])


def start_values(p: Parameters) -> dict[str, Value]:
    """Start values of plant, isolator, commander and disturbance source that a parameter set states.

    Modes that the set does not have are zero.  Raises ParameterError as :func:`fit_modes`.
    """
    p = fit_modes(p)
    components = {
        "plant": list_entries(Plant.from_parameters(p)),
        "isolator": list_entries(Isolator.from_parameters(p)),
        "commander": list_entries(Commander.from_parameters(p), keep=is_geometric),
        "disturbance": list_entries(default_settings(p)),
    }
    return {f"{component}.{entry.name}": entry.value for component, found in components.items() for entry in found}


def differences(p: Parameters) -> dict[str, Value]:
    """The start values that are not those of paper.toml."""
    paper = start_values(load())
    return {name: value for name, value in start_values(p).items() if value != paper[name]}


def build_plant_and_isolator(system: System) -> tuple[Plant, Isolator]:
    """Plant and isolator from the start values of a system; values that it does not give are those of paper.toml.

    Raises
    ------
    ParameterError: an impossible value.
    """
    p = load()
    return (
        take_values(Plant.from_parameters(p), _given(system, "plant")),
        take_values(Isolator.from_parameters(p), _given(system, "isolator")),
    )


def list_departures(given: Mapping[str, Value]) -> list[str]:
    """Names of the start values that make another system than that of paper.toml with an ideal isolator."""
    paper = start_values(load()) | IDEAL
    return [name for name, value in given.items() if paper.get(name, value) != value]


def _given(system: System, component: str) -> dict[str, Value]:
    return {name: entry.value for name, entry in system.component(component).parameters.items()}
