"""The loop of a system: in closed form from its start values, and measured on its FMUs with the loop cut open.

The loop is opened at one axis of the controller's input by a second plant with a tracker of its own.  The disturbance
shakes that plant; the controller is given the error that its tracker (``eye``) measures about the one axis, and those
of the system's own tracker about the others; its forces act on the system's plant, which nothing else shakes.  Minus
the error of the system's tracker over that of the eye is the loop transfer of the axis with the others closed.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..control.pointing import PointingLaw
from ..cosim import System, Value
from ..interface.start_values import build_plant_and_isolator
from ..mechanism.parameters import load
from ..mechanism.quantities import Array, take_values
from ..pointing.response import Response
from ..runs.options import OptionError
from ..runs.system import RunSystem
from ..sensors.line_of_sight import DEFAULT_TRACKER, Tracker
from ..theory.line_of_sight import AXES, AxisMargins, PointingLoop, Timing, margins_of
from ..theory.loop import loop_of
from ..theory.sampled import LOOP_DELAY
from .shaking import Shaking, measure_response

SHAKEN, EYE = "shaken", "eye"
BOTH = (EYE, "tracker")
WIDE = {"field_of_view": 2.0, "acquisition_field": 2.0, "acquisition_time": 0.0}  # rad, s: always locked
#: Components and their parameters that would disturb the measurement at random.
AT_RANDOM = {
    "disturbance": [f"wheel_{k}.enabled" for k in range(1, 5)],
    "sensors": [
        f"{sensor}.{error}"
        for sensor in ("accelerometer", "rate_sensor")
        for error in ("noise_density", "bias_instability", "random_walk", "resolution")
    ],
}
#: Torque about an axis of B turns the payload about that of P.
SHAKEN_BY = {"x": "tx", "y": "ty", "z": "tz"}


@dataclass(frozen=True, eq=False)
class MeasuredLoop:
    """The loop transfer of one axis with the others closed, as measured."""

    response: Response
    """(n, 1, 1)."""
    reference: NDArray[np.complex128]
    """(n,), closed form at the same lines."""
    margins: AxisMargins

    @property
    def values(self) -> NDArray[np.complex128]:
        """(n,)."""
        return np.asarray(self.response.matrix[:, 0, 0])

    @property
    def deviation(self) -> tuple[float, float]:
        """Largest deviation from the closed form where the gain is above -20 dB: dB, deg."""
        ratio = (self.values / self.reference)[np.abs(self.reference) > 0.1]
        return float(20.0 * np.abs(np.log10(np.abs(ratio))).max()), float(np.abs(np.degrees(np.angle(ratio))).max())


def read_tracker(system: RunSystem) -> Tracker:
    """The tracker of the start values of a system."""
    return take_values(DEFAULT_TRACKER, _values(system.structure, "tracker"))


def build_loop(system: RunSystem, orientation: Array, step_s: float) -> PointingLoop:
    """The loop in closed form, of the start values of a system, at an orientation (3,), rad."""
    structure = system.structure
    plant, isolator = build_plant_and_isolator(structure)
    law = take_values(PointingLaw.from_parameters(load()), _values(structure, "pointing"))
    tracker = read_tracker(system)
    # Holds of isolator and plant, and the direct effect of the force half a step late (theory/sampled.py); each FMU
    # between plant and isolator adds a step.
    between = 0 if any(c.source.component == "plant" for c in structure.connections if _is_isolator(c.target)) else 1
    latency = system.get_number("sensors.latency") if between and "latency" in _names(system, "sensors") else 0.0
    exchange = max(latency, between * step_s) + LOOP_DELAY * step_s
    loop = loop_of(plant, isolator, orientation, system.get_number("isolator.delay") + exchange)
    timing = Timing(
        sample_time=tracker.sample_time,
        latency=max(tracker.latency, step_s),
        step=step_s,
        control_sample_time=system.get_number("pointing.sample_time"),
        control_delay=system.get_number("pointing.delay"),
    )
    return PointingLoop(loop, law.controller(orientation), timing)


def make_shaking(step_s: float, sample_time: float) -> Shaking:
    """How the loop is shaken to measure it: rows at the tracker's samples, lines far below half their rate.

    Raises OptionError if the samples are no whole number of steps apart, or a record no whole number of samples.
    """
    samples = np.array([sample_time / step_s, 5.0 / sample_time])
    if np.abs(samples / samples.round() - 1.0).max() > 1e-9:
        raise OptionError(
            f"--step: the loop is measured at the samples of the tracker: expected a step that divides their distance "
            f"(tracker.sample_time = {sample_time:g} s), which divides 5 s; got {step_s:g} s"
        )
    return Shaking(
        half_period=20.0,
        settling=20.0,
        band=(0.15, 0.25 / sample_time),
        step=step_s,
        stride=round(sample_time / step_s),
        density=1e-6,  # so weak that the plant keeps its linear model, and the loop its transfer
    )


def measure_loop(
    system: System,
    reference: PointingLoop,
    shaking: Shaking,
    values: Mapping[str, Value],
    target: Sequence[float],
    seed: int = 1,
    progress: Callable[[], object] | None = None,
    axes: Sequence[str] = AXES,
) -> dict[str, MeasuredLoop]:
    """Measure axes of the loop on the FMUs of a system.

    Parameters
    ----------
    reference: the loop in closed form.
    values: start values of the run, for example the orientation.
    target: attitude of the target, where the payload looks, scalar first.
    progress: called after each run; an axis takes ``shaking.seeds`` of them.

    Raises :class:`ps_fmu.cosim.CosimError`.
    """
    found = {}
    for axis in axes:
        opened = cut_loop(system, axis)
        quiet = {
            **values,
            **{f"{EYE}.{name}": value for name, value in _values(system, "tracker").items()},
            **{f"{SHAKEN}.{name}": value for name, value in _values(system, "plant").items()},
            **{f"{part}.{name}": value for part in BOTH for name, value in WIDE.items()},
            **{f"{part}.target_attitude.{k}": v for part in BOTH for k, v in zip("wxyz", target, strict=True)},
            **{f"{part}.noise_equivalent_angle.{one}": 0.0 for part in BOTH for one in AXES},
            **_silence(system),
        }
        opened = opened.with_parameters(quiet)
        shaken = [opened.with_parameters(shaking.values(SHAKEN_BY[axis], seed + j)) for j in range(shaking.seeds)]
        name = f"line_of_sight_error.{axis}"
        response = measure_response(shaken, shaking, (f"{EYE}.{name}",), (f"tracker.{name}",), progress)
        response = replace(response, matrix=-response.matrix)
        closed = reference.axis_transfer(2j * np.pi * response.frequency, AXES.index(axis))
        margins = margins_of(response.frequency, response.matrix[:, 0, 0], axis)
        found[axis] = MeasuredLoop(response, closed, margins)
    return found


def cut_loop(system: System, axis: str) -> System:
    """The system with the loop open at an axis, see the module's text."""
    components = (
        *system.components,
        replace(system.component("plant"), name=SHAKEN),
        replace(system.component("tracker"), name=EYE),
    )
    connections = []
    for c in system.connections:
        source, target = c.source, c.target
        if source.component == "disturbance":
            connections.append(replace(c, target=target._replace(component=SHAKEN)))
            continue
        if source.component == "tracker" and source.variable == f"line_of_sight_error.{axis}":
            connections.append(replace(c, source=source._replace(component=EYE)))
            continue
        connections.append(c)
        if source.component == "commander" and target.component == "plant":
            connections.append(replace(c, target=target._replace(component=SHAKEN)))
        elif source.component == "plant" and target.component == "tracker":
            connections.append(
                replace(c, source=source._replace(component=SHAKEN), target=target._replace(component=EYE))
            )
    return replace(system, components=components, connections=tuple(connections))


def _is_isolator(target: object) -> bool:
    return str(target).startswith("isolator.base_acceleration")


def _names(system: RunSystem, component: str) -> set[str]:
    return {variable.name for variable in system.descriptions[component].modelVariables}


def _silence(system: System) -> dict[str, Value]:
    present = {component.name for component in system.components}
    return {
        f"{component}.{name}": False if name.endswith("enabled") else 0.0
        for component, names in AT_RANDOM.items()
        for name in names
        if component in present
    }


def _values(system: System, component: str) -> dict[str, Value]:
    return {name: entry.value for name, entry in system.component(component).parameters.items()}
