"""The components of a system description as objects of the physics, with the start values of their FMUs.

Sensors, coils and the pointing loop are imported where a system has them: most systems have none.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ..control.isolator import Isolator
from ..cosim import System, Value
from ..cosim.ssp.packing import find_values
from ..mechanism.linear_model import Plant
from ..mechanism.parameters import load
from ..mechanism.quantities import Array, ParameterError, list_entries, take_values
from ..mechanism.signals import OUTPUTS
from ..theory.loop import Loop, loop_of
from ..theory.sampled import round_delay

if TYPE_CHECKING:
    from ..actuators.voice_coil import Coils
    from ..disturbance.total import DisturbanceSettings
    from ..sensors.inertial import InertialSensors
    from ..sensors.line_of_sight import Tracker
    from ..theory.line_of_sight import SampledPointing

STEP = 1e-4  # s, where the description states none
PLANT, ISOLATOR, SOURCE, COMMANDER = "ManipulatorPlant", "FeedforwardIsolator", "DisturbanceSource", "PointingCommander"
SENSORS, COILS, TRACKER, POINTING = "InertialSensors", "VoiceCoils", "LineOfSightSensor", "PointingController"
NEEDED = (PLANT, ISOLATOR, SOURCE, COMMANDER)
KNOWN = (*NEEDED, SENSORS, COILS, TRACKER, POINTING)
OUTPUT_NAMES = tuple(name for signal in OUTPUTS for name in signal.names)
DAMPING = tuple(f"fine_leg_{leg}.damping" for leg in (1, 2, 3))
#: What stability depends on: parameters by FMU, those together that are turned together.
TURNED: Mapping[str, Sequence[tuple[str, ...]]] = {
    PLANT: (("bus.mass",), DAMPING),
    ISOLATOR: (
        ("delay",), ("filters.lowpass_stop_frequency",), ("filters.highpass_frequency",),
        ("filters.highpass_damping_ratio",), ("payload.mass",),
    ),
    SENSORS: (("latency",), ("accelerometer.bandwidth",)),
    COILS: (("driver.bandwidth",),),
    TRACKER: (("sample_time",), ("latency",)),
    POINTING: (
        ("delay",), ("sample_time",), ("loop.crossover_frequency",), ("loop.integral_frequency",),
        ("loop.rolloff_frequency",),
    ),
}  # fmt: skip
#: Parameters that are delays, s, by FMU: an FMU rounds each up to the next multiple of its step.
DELAYS: Mapping[str, str] = {ISOLATOR: "delay", POINTING: "delay", SENSORS: "latency", TRACKER: "latency"}


class LinearModelError(ValueError):
    """A system or a source that the closed form does not know; the text says which, and what to do."""


class Turned(NamedTuple):
    """A parameter that stability depends on."""

    value: float
    unit: str


@dataclass(frozen=True, eq=False)
class SystemModel:
    """The components of a system with their start values, as objects of the physics."""

    system: System
    components: Mapping[str, str]  # name in the system by the name of the FMU
    loop: Loop  # plant and isolator at the target of the commander, without delay
    isolator_delay: float  # of its forces, s
    sensors: InertialSensors | None
    coils: Coils | None
    tracker: Tracker | None
    pointing: SampledPointing | None
    step: float  # s

    @property
    def name(self) -> str:
        """Name of the system file."""
        return self.system.path.stem

    @cached_property
    def disturbance(self) -> DisturbanceSettings:
        """What the source of disturbances makes.  Raises ``ParameterError`` for an impossible value."""
        return read_disturbance(self.system, self.components[SOURCE])

    @cached_property
    def turned(self) -> Mapping[str, Turned]:
        """The parameters in :data:`TURNED`, by ``component.parameter``."""
        return dict(_list_turned(self.system, self.components))

    def without_pointing(self) -> SystemModel:
        """The same system with the line-of-sight loop off."""
        return replace(self, tracker=None, pointing=None)

    @property
    def groups(self) -> list[list[str]]:
        """Names of :attr:`turned`, those together that are turned together."""
        return [
            [f"{self.component(fmu)}.{name}" for name in names]
            for fmu, groups in TURNED.items()
            if fmu in self.components
            for names in groups
        ]

    def component(self, fmu: str) -> str:
        """Return the name of the component that is an FMU of this model."""
        return self.components[fmu]


def read_model(system: System, step: float | None = None) -> SystemModel:
    """Read the linear model of a system with its start values; the FMUs give the values that the system does not set.

    ``step``: communication step, s; None: the step of the system.  Raises :class:`LinearModelError` for a component
    without a closed form, and ``ParameterError`` for an impossible value.
    """
    components = {component.source.stem: component.name for component in system.components}
    for fmu in components:
        if fmu not in KNOWN:
            unknown = f"the linear model does not include the FMU {fmu}; it includes {', '.join(KNOWN)}"
            raise LinearModelError(f"{components[fmu]}: {unknown}")
    if len(components) < len(system.components):
        names = [component.source.stem for component in system.components]
        twice = next(fmu for fmu in names if names.count(fmu) > 1)
        there = f"the linear model includes one {twice}, and the system has {names.count(twice)}"
        raise LinearModelError(f"{system.path.name}: {there}")
    if missing := [fmu for fmu in NEEDED if fmu not in components]:
        raise LinearModelError(f"{system.path.name}: the linear model needs the FMU {missing[0]}")
    h = step or system.experiment.step or STEP
    isolator, commander = _given(system, components[ISOLATOR]), _given(system, components[COMMANDER])
    orientation = np.array([float(commander.get(f"target.{angle}", 0.0)) for angle in ("roll", "pitch", "yaw")])
    if isolator.get("sample_time"):
        name = f"{components[ISOLATOR]}.sample_time"
        raise LinearModelError(f"{name}: the linear model does not include a digital isolator; set 0 s")
    if _given(system, components[PLANT]).get("base", "own") != "own":
        name = f"{components[PLANT]}.base"
        raise LinearModelError(f"{name}: the linear model does not include a base that its host moves; set own")
    plant, controller = (_take(system, components[fmu], fmu) for fmu in (PLANT, ISOLATOR))
    tracker = _take(system, components[TRACKER], TRACKER) if {TRACKER, POINTING} <= components.keys() else None
    return SystemModel(
        system,
        components,
        loop_of(plant, controller, orientation, 0.0),
        round_delay(float(isolator.get("delay", 0.0)), h),
        _take(system, components[SENSORS], SENSORS) if SENSORS in components else None,
        _take(system, components[COILS], COILS) if COILS in components else None,
        tracker,
        None if tracker is None else _make_pointing(system, components[POINTING], tracker, orientation, h),
        h,
    )


def read_disturbance(system: System, component: str) -> DisturbanceSettings:
    """What a source of disturbances makes with its start values.  Raises ``ParameterError`` for an impossible value."""
    from ..disturbance import default_settings  # here: whether a loop is stable does not depend on it

    try:
        return take_values(default_settings(load()), find_values(system.component(component)))
    except ParameterError as error:
        raise ParameterError(f"{component}.{error.name}", error.problem) from None


def _list_turned(system: System, components: Mapping[str, str]) -> Iterator[tuple[str, Turned]]:
    """The parameters in TURNED by name."""
    for fmu in TURNED.keys() & components.keys():
        given, known = _given(system, components[fmu]), {entry.name: entry for entry in list_entries(_make(fmu))}
        for name in (name for names in TURNED[fmu] for name in names):
            value, unit = (known[name].value, known[name].unit) if name in known else (0.0, "s")  # of delays
            yield f"{components[fmu]}.{name}", Turned(float(given.get(name, value)), unit)


def _make_pointing(
    system: System, component: str, tracker: Tracker, orientation: Array, h: float
) -> SampledPointing:
    from ..theory.line_of_sight import SampledPointing, Timing

    law, given = _take(system, component, POINTING), _given(system, component)
    own = float(given.get("sample_time", 0.0)), round_delay(float(given.get("delay", 0.0)), h)
    timing = Timing(tracker.sample_time, round_delay(tracker.latency, h), h, *own)
    return SampledPointing(law.controller(orientation), timing, tracker.roll_measured)


def _make(fmu: str) -> Any:
    """The physics of an FMU with the values that it starts with by itself."""
    if fmu == PLANT:
        return Plant.from_parameters(load())
    if fmu == ISOLATOR:
        return Isolator.from_parameters(load())
    if fmu == SENSORS:
        from ..sensors.inertial import default_sensors

        return default_sensors()
    if fmu == COILS:
        from ..actuators.voice_coil import Coils

        return Coils.from_parameters(load())
    if fmu == TRACKER:
        from ..sensors.line_of_sight import DEFAULT_TRACKER

        return DEFAULT_TRACKER
    from ..control.pointing import PointingLaw

    return PointingLaw.from_parameters(load())


def _take(system: System, component: str, fmu: str) -> Any:
    """The physics of a component with its start values.  Raises ParameterError, naming the component, too."""
    try:
        return take_values(_make(fmu), _given(system, component))
    except ParameterError as error:
        raise ParameterError(f"{component}.{error.name}", error.problem) from None


def _given(system: System, component: str) -> dict[str, Value]:
    return {name: entry.value for name, entry in system.component(component).parameters.items()}
