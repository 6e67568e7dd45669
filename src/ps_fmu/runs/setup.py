"""The system of a run: the wiring, the scenario's settings, the user's parameter files, and what they add up to."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from fmpy.model_description import ModelVariable

from ..cosim import System, UsageError, Value, read_parameters, read_system
from ..cosim.description import read_description, typed_value, unit_of, variable_of, variables_of
from ..cosim.structure import Parameter, port_of
from ..results.summary import FmuFile
from .options import RunOptions

SEED = "disturbance.seed"
NOISE = "disturbance.noise.enabled"
HIGHEST_NOISE = "disturbance.noise.band.max"  # Hz
#: Highest frequency of the noise over the rate of the steps.  What is above half that rate would fold down to low
#: frequencies, where the same force moves the bus a thousand times more.
HIGHEST_PER_RATE = 0.4


def load_system(options: RunOptions, defaults: Mapping[str, Value] | None = None) -> System:
    """The system of the options, with the scenario's ``defaults``, the seed, and then the user's parameter files.

    Where the step is too long for the band of the noise, and no parameter file sets that band, it is lowered and
    the terminal says so.

    Raises :class:`ps_fmu.cosim.SystemFileError` or :class:`ps_fmu.cosim.UsageError` naming the file and line.
    """
    system = read_system(options.system, options.fmus)
    given = user_parameters(options)
    system = system.with_parameters({**(defaults or {}), SEED: options.seed}).with_parameters(given)
    return system if HIGHEST_NOISE in given else _without_aliases(system, options.step_s)


def user_parameters(options: RunOptions) -> dict[str, Parameter]:
    """What the parameter files of the options say, by ``component.variable``; later files win."""
    found: dict[str, Parameter] = {}
    for path in options.parameters:
        found |= read_parameters(path).entries()
    return found


def start_value(system: System, name: str) -> Value:
    """The value that ``component.variable`` will start with: as set in the system, or else as its FMU has it.

    Raises :class:`ps_fmu.cosim.UsageError` for a value that is not of the variable's type or unit.
    """
    port = port_of(name)
    component = system.component(port.component)
    variable = variable_of(read_description(component.source), port.variable)
    given = component.parameters.get(port.variable)
    if given is None:
        return _own_start(variable)
    if given.unit and unit_of(variable) and given.unit != unit_of(variable):
        raise UsageError(f"{name} ({given.origin}): is given in {given.unit!r}, its unit is {unit_of(variable)!r}")
    try:
        return typed_value(variable, given.value)
    except UsageError as error:
        raise UsageError(f"{name} ({given.origin}): {error}") from error


def real_start(system: System, name: str) -> float:
    """:func:`start_value` of a number."""
    return float(start_value(system, name))


def given_parameters(options: RunOptions, system: System) -> dict[str, object]:
    """Options, the seed, and all start values that differ from those of the FMUs, for report and summary."""
    given: dict[str, object] = {
        "scenario": options.scenario.name,
        "duration (s)": options.duration_s,
        "step (s)": options.step_s,
        "storage step (s)": options.storage_s,
        "scheme": options.scheme,
        SEED: start_value(system, SEED),
    }
    for component in system.components:
        variables = variables_of(read_description(component.source))
        given |= {
            f"{component.name}.{name}": entry.value
            for name, entry in component.parameters.items()
            if entry.value != _own_start(variables[name])
        }
    return given


def fmu_files(system: System) -> tuple[FmuFile, ...]:
    """Name and SHA-256 of each FMU of the system."""
    return tuple(FmuFile.of(component.source) for component in system.components)


def _own_start(variable: ModelVariable) -> Value:
    text = str(variable.start)
    if variable.type == "Boolean":
        return text in ("true", "1")
    if variable.type == "Real":
        return float(text)
    return int(text) if variable.type in ("Integer", "Enumeration") else text


def _without_aliases(system: System, step_s: float) -> System:
    highest = HIGHEST_PER_RATE / step_s
    if not start_value(system, NOISE) or highest >= real_start(system, HIGHEST_NOISE):
        return system
    print(
        f"The noise ends at {highest:g} Hz: a step of {step_s:g} s would fold what is above down to low "
        f"frequencies ({HIGHEST_NOISE} in a parameter file overrides this).",
        file=sys.stderr,
    )
    return system.with_parameters({HIGHEST_NOISE: highest})
