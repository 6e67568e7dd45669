"""A single FMU as a system, whose inputs are those of the run; and any system, in whatever form it is."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

from fmpy.model_description import ModelDescription

from ..clock import count_steps
from ..description import read_description
from ..structure import Component, Experiment, Parameter, PortName, System, SystemInput
from ..values import End, parse_real
from .reading import read_system


def read_any_system(
    path: Path, resources: Path | None = None, *, outside: bool = False, values: Sequence[Mapping[str, Parameter]] = ()
) -> System:
    """A system as ``ps-fmu run`` takes it: a single FMU, or what :func:`.reading.read_system` reads, leniently."""
    if path.suffix.lower() == ".fmu":
        return read_single(path, values)
    return read_system(path, resources, outside=outside, lenient=True, values=values)


def read_single(fmu: Path, values: Sequence[Mapping[str, Parameter]] = ()) -> System:
    """A system with one component, called as the model is; it starts when the FMU's default experiment does.

    ``values``: start values by ``variable`` or ``component.variable``; later ones win.  Raises
    :class:`SystemFileError` if the FMU cannot be read.
    """
    description = read_description(fmu, lenient=True)
    name = description.coSimulation.modelIdentifier
    prefix = f"{name}."
    variables = {variable.name for variable in description.modelVariables}
    given = {
        key if key in variables else key.removeprefix(prefix): value for one in values for key, value in one.items()
    }
    inputs = tuple(
        SystemInput(variable.name, End(), ((PortName(name, variable.name), ()),), 0)
        for variable in description.modelVariables
        if variable.causality == "input"
    )
    component = Component(name, Path(fmu).absolute(), (), given, 0)
    own = description.defaultExperiment
    start = None if own is None else _read_time(own.startTime)
    return System(Path(fmu), (component,), (), Experiment(start or 0.0), labels={"name": name}, inputs=inputs)


def complete_experiment(system: System, descriptions: Mapping[str, ModelDescription]) -> Experiment:
    """The default experiment of a system, with what it does not state from those of its FMUs.

    The smallest of their steps is the communication step, and the latest of their stop times the end.
    """
    stated = system.experiment
    own = [d.defaultExperiment for d in descriptions.values() if d.defaultExperiment is not None]
    steps = [step for e in own if (step := _read_time(e.stepSize)) is not None and step > 0.0]
    stops = [stop for e in own if (stop := _read_time(e.stopTime)) is not None and stop > stated.start_time]
    step = min(steps, default=None) if stated.step is None else stated.step
    stop = max(stops, default=None) if stated.stop_time is None else stated.stop_time
    return replace(stated, step=step, stop_time=stop)


def fit_duration(duration: float, step: float) -> float:
    """The longest whole number of steps within a duration [s], at least one; one too long to count stays."""
    if not math.isfinite(duration / step):
        return duration
    count = count_steps(duration, step) or max(1, int(duration / step))
    return count * step


def _read_time(text: str | None) -> float | None:
    """A time [s] that an FMU states; None for what is no finite number, as a description that breaks rules may have."""
    return None if text is None else parse_real(str(text))
