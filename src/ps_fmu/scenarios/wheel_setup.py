"""Wheels, modes and responses of the scenario wheels, from the start values of a system."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..disturbance import DisturbanceSettings, default_settings
from ..disturbance.wheels import WheelSource
from ..interface.start_values import build_plant_and_isolator
from ..mechanism.parameters import load
from ..mechanism.quantities import Array, Complex, ParameterError, list_entries, take_values
from ..runs.options import OptionError
from ..runs.setup import RunSystem
from ..theory.loop import Loop, loop_of
from ..theory.natural_modes import NaturalMode, find_natural_modes
from ..theory.sampled import from_wrench_stepped
from .wheel_crossings import Response, Wheel

COMPONENT = "disturbance"


def read_wheels(system: RunSystem) -> list[Wheel]:
    """The wheels that are on.

    Raises OptionError if none is, if a file of speeds cannot be used, or the disturbance source has no wheels.
    """
    settings = _read_settings(system)
    found = []
    for name, number, kind in settings.list_disturbances():
        try:
            source = kind.make_source(settings, number)
        except ParameterError as error:
            raise OptionError(f"--parameters: {COMPONENT}.{name}.{error}") from error
        if isinstance(source, WheelSource):
            found.append(Wheel(name, source.profile, source))
    if not found:
        raise OptionError(
            "--parameters: the scenario wheels needs a wheel that is on, such as disturbance.wheel_1.enabled"
        )
    return found


def build_loop(system: RunSystem, orientation: Sequence[float]) -> Loop:
    """Plant and isolator of the start values at an orientation, roll, pitch, yaw, rad."""
    plant, isolator = build_plant_and_isolator(system.structure)
    return loop_of(plant, isolator, np.asarray(orientation), system.get_number("isolator.delay"))


def make_response(loop: Loop, step_s: float, *, active: bool) -> Response:
    """From the wrench on the bus to the payload's rotation, as the FMUs step.

    Other FMUs between plant and isolator are left out.
    """

    def respond(frequency: Array) -> Complex:
        controller = loop.controller if active else None
        return from_wrench_stepped(loop.model, controller, frequency, step_s, delay=loop.delay)

    return respond


def list_modes(loop: Loop, step_s: float) -> list[NaturalMode]:
    """The natural modes that the steps can show: below half their rate."""
    return [mode for mode in find_natural_modes(loop.model.dynamics) if mode.frequency < 0.5 / step_s]


def _read_settings(system: RunSystem) -> DisturbanceSettings:
    """The settings of the disturbance source, with nothing on that is not a wheel."""
    names = {variable.name for variable in system.descriptions[COMPONENT].modelVariables}
    default = default_settings(load())
    wanted = [entry.name for entry in list_entries(default)]
    if missing := [name for name in wanted if name.startswith("wheel_") and name not in names]:
        raise OptionError(f"--system: the scenario wheels needs the parameter {COMPONENT}.{missing[0]}")
    values = {name: system.get_start(f"{COMPONENT}.{name}") for name in wanted if name in names}
    settings = take_values(default, values)
    return replace(settings, kinds={"wheels": settings.kinds["wheels"]})
