"""The linear model of a system description, and the sources of error in it: what its FMUs step, in closed form."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TypeVar

import numpy as np

from ...actuators.voice_coil import Coils
from ...control.isolator import Isolator
from ...control.pointing import PointingLaw
from ...cosim import System, Value
from ...disturbance import default_settings
from ...disturbance.total import DisturbanceSettings
from ...mechanism.linear_model import Plant
from ...mechanism.parameters import load
from ...mechanism.quantities import Array, Complex, ParameterError, take_values
from ...mechanism.signals import OUTPUTS
from ...pointing.modal import StateSpace
from ...sensors.inertial import InertialSensors, default_sensors
from ...sensors.line_of_sight import DEFAULT_TRACKER, Tracker
from ...theory.line_of_sight import SampledPointing, Timing, close_loop
from ...theory.loop import Loop, loop_of
from ...theory.sampled import (
    FORCES,
    WRENCH,
    Block,
    connect,
    make_coils_block,
    make_isolator_block,
    make_plant_block,
    make_sensors_block,
)

STEP = 1e-4  # s, where the description states none
PLANT, ISOLATOR, SOURCE, COMMANDER = "ManipulatorPlant", "FeedforwardIsolator", "DisturbanceSource", "PointingCommander"
SENSORS, COILS, TRACKER, POINTING = "InertialSensors", "VoiceCoils", "LineOfSightSensor", "PointingController"
NEEDED = (PLANT, ISOLATOR, SOURCE, COMMANDER)
KNOWN = (*NEEDED, SENSORS, COILS, TRACKER, POINTING)
#: What the tracker sees: the boresight, which truss modes turn, and the roll of the platform.
SEEN = ("line_of_sight.x", "line_of_sight.y", "payload_rotation.z")
OUTPUT_NAMES = tuple(name for signal in OUTPUTS for name in signal.names)

T = TypeVar("T")


class BudgetError(ValueError):
    """A system or a source that the closed form does not know; the text says which, and what to do."""


@dataclass(frozen=True, eq=False)
class SystemModel:
    """The components of a system with their start values, as the physics knows them."""

    system: System
    components: Mapping[str, str]  # name in the system by the name of the FMU
    loop: Loop  # plant and isolator at the target of the commander, without delay
    isolator_delay: float  # of its forces, s
    disturbance: DisturbanceSettings
    sensors: InertialSensors | None
    coils: Coils | None
    tracker: Tracker | None
    pointing: SampledPointing | None
    step: float  # s

    @property
    def name(self) -> str:
        """Of the file of its description."""
        return self.system.path.stem

    def component(self, fmu: str) -> str:
        """Name of the component that an FMU of this name is."""
        return self.components[fmu]


@dataclass(frozen=True, eq=False)
class Circuit:
    """The wired model with the isolator on or off, with the inputs that sources act on."""

    model: SystemModel
    active: bool

    @property
    def closed(self) -> bool:
        """Whether a line-of-sight loop is closed."""
        return self.active and self.model.pointing is not None

    @cached_property
    def blocks(self) -> dict[str, Block]:
        """By the name of the component."""
        m, h = self.model, self.model.step
        found = {PLANT: make_plant_block(m.loop.model, h)}
        if self.active:
            found[ISOLATOR] = make_isolator_block(m.loop.controller, h, m.isolator_delay)
        if m.sensors is not None and self.active:
            found[SENSORS] = make_sensors_block(m.sensors, h)
        if m.coils is not None:
            found[COILS] = make_coils_block(m.coils, h)
        return {m.component(fmu): block for fmu, block in found.items()}

    @cached_property
    def channels(self) -> dict[str, tuple[str, ...]]:
        """Inputs of the model, ``component.input``, by what acts on them; the tracker's noise acts on the forces."""
        m = self.model
        found = {SOURCE: tuple(f"{m.component(PLANT)}.{name}" for name in WRENCH)}
        if m.sensors is not None and self.active:
            on = np.flatnonzero(m.sensors.enabled[:12])
            found[SENSORS] = tuple(f"{m.component(SENSORS)}.noise_{k + 1}" for k in on)
        if m.coils is not None:
            found[COILS] = tuple(f"{m.component(COILS)}.noise_{i}" for i in (1, 2, 3))
        if self.closed:
            found[TRACKER] = tuple(self._find_target(f"{m.component(POINTING)}.{name}") for name in FORCES)
        return found

    @cached_property
    def poles(self) -> Complex:
        """(n,), rad/s, a line-of-sight loop open."""
        found = self._connect([], []).poles
        return np.asarray(found[np.isfinite(found)])

    def respond(self, frequency: Array, signals: Sequence[str], sources: Sequence[str]) -> Complex:
        """(n, signals, channels), from the channels of some sources (FMUs, in the order of :attr:`channels`).

        To outputs of the plant, at frequencies (n,), Hz.
        """
        sources = [fmu for fmu in self.channels if fmu in sources]
        if not self.closed:
            return self._connect(self._list_inputs(sources), signals).response(frequency)
        assert self.model.pointing is not None
        inputs = self._list_inputs([*(fmu for fmu in sources if fmu != TRACKER), TRACKER])
        answers, errors = np.split(self._connect(inputs, [*signals, *SEEN]).response(frequency), [len(signals)], axis=1)
        K = self.model.pointing.response(frequency)
        closed = close_loop(K, errors, answers, slice(len(inputs) - 3, None))
        return closed if TRACKER in sources else closed[..., :-3]

    def _list_inputs(self, sources: Sequence[str]) -> list[str]:
        return [name for fmu in sources for name in self.channels[fmu]]

    def _connect(self, inputs: Sequence[str], signals: Sequence[str]) -> StateSpace:
        """From inputs ``component.input`` to outputs of the plant; a state for no other output than is needed."""
        outputs = [f"{self.model.component(PLANT)}.{name}" for name in signals]
        wires = [(str(wire.source), str(wire.target)) for wire in self.model.system.connections]
        found = connect(self.blocks, wires, inputs, outputs, self.model.step)
        return StateSpace(found.A, found.B, found.C, found.step)

    def _find_target(self, output: str) -> str:
        """The input that an output is connected with."""
        for wire in self.model.system.connections:
            if str(wire.source) == output:
                return str(wire.target)
        raise BudgetError(f"{output}: it is connected with nothing")


def read_model(system: System, step: float | None = None) -> SystemModel:
    """The model of a system, with its start values; those that it does not give are those of the FMUs.

    ``step``: s; None: that of the system.  Raises :class:`BudgetError` for a component that the closed form does not
    know, and ``ParameterError`` for an impossible value.
    """
    components = {component.source.stem: component.name for component in system.components}
    for fmu in components:
        if fmu not in KNOWN:
            known = ", ".join(KNOWN)
            raise BudgetError(f"{components[fmu]}: there is no closed form of the FMU {fmu}; there is of {known}")
    if len(components) < len(system.components):
        names = [component.source.stem for component in system.components]
        twice = next(fmu for fmu in names if names.count(fmu) > 1)
        raise BudgetError(f"{system.path.name}: a budget is of one {twice}, there are {names.count(twice)}")
    if missing := [fmu for fmu in NEEDED if fmu not in components]:
        raise BudgetError(f"{system.path.name}: a budget needs the FMU {missing[0]}")
    h = step or system.experiment.step or STEP
    p, isolator, commander = load(), _given(system, components[ISOLATOR]), _given(system, components[COMMANDER])
    orientation = np.array([float(commander.get(f"target.{angle}", 0.0)) for angle in ("roll", "pitch", "yaw")])
    if isolator.get("sample_time"):
        raise BudgetError(f"{components[ISOLATOR]}.sample_time: there is no closed form of a digital isolator; set 0 s")
    plant = _take(system, components[PLANT], Plant.from_parameters(p))
    controller = _take(system, components[ISOLATOR], Isolator.from_parameters(p))
    looped = TRACKER in components and POINTING in components
    tracker = _take(system, components[TRACKER], DEFAULT_TRACKER) if looped else None
    return SystemModel(
        system,
        components,
        loop_of(plant, controller, orientation, 0.0),
        float(isolator.get("delay", 0.0)),
        _take(system, components[SOURCE], default_settings(p)),
        _take(system, components[SENSORS], default_sensors()) if SENSORS in components else None,
        _take(system, components[COILS], Coils.from_parameters(p)) if COILS in components else None,
        tracker,
        None if tracker is None else _make_pointing(system, components[POINTING], tracker, orientation, h),
        h,
    )


def _make_pointing(
    system: System, component: str, tracker: Tracker, orientation: Array, h: float
) -> SampledPointing:
    law, given = _take(system, component, PointingLaw.from_parameters(load())), _given(system, component)
    own = [float(given.get(name, 0.0)) for name in ("sample_time", "delay")]
    timing = Timing(tracker.sample_time, tracker.latency, h, *own)
    return SampledPointing(law.controller(orientation), timing, tracker.roll_measured)


def _take(system: System, component: str, default: T) -> T:
    """The physics of a component with its start values.  Raises ParameterError, naming the component, too."""
    try:
        return take_values(default, _given(system, component))
    except ParameterError as error:
        raise ParameterError(f"{component}.{error.name}", error.problem) from None


def _given(system: System, component: str) -> dict[str, Value]:
    return {name: entry.value for name, entry in system.component(component).parameters.items()}
