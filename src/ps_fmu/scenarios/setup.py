"""The system of a run: the wiring, the scenario's settings, the user's parameter files, and what they add up to."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from ..cosim import System, UsageError, Value, read_parameters, read_system
from ..cosim.description import read_description, typed_value, variable_of
from ..cosim.structure import Parameter, port_of
from ..pointing.summary import FmuFile
from .options import RunOptions

SEED = "disturbance.seed"
NOISE = "disturbance.noise.enabled"
HIGHEST_NOISE = "disturbance.noise.band.max"  # Hz
#: Highest frequency of the noise over the rate of the steps.  What is above half that rate would fold down to low
#: frequencies, where the same force moves the bus a thousand times more.
HIGHEST_PER_RATE = 0.4


def load_system(options: RunOptions, defaults: Mapping[str, Value] | None = None) -> System:
    """The system of the options, with the scenario's ``defaults``, the seed, and then the user's parameter files.

    Where the step is too long for the band of the noise, and nobody has set that band, it is lowered and the
    terminal says so.

    Raises :class:`ps_fmu.cosim.SystemFileError` or :class:`ps_fmu.cosim.UsageError` naming the file and line.
    """
    system = read_system(options.system, options.fmus)
    system = system.with_parameters({**(defaults or {}), SEED: options.seed})
    return _without_aliases(system.with_parameters(user_parameters(options)), options.step_s)


def user_parameters(options: RunOptions) -> dict[str, Parameter]:
    """What the parameter files of the options say, by ``component.variable``; later files win."""
    found: dict[str, Parameter] = {}
    for path in options.parameters:
        found |= read_parameters(path).entries()
    return found


def start_value(system: System, name: str) -> Value:
    """The value that ``component.variable`` will start with: as set in the system, or else as its FMU has it.

    Raises :class:`ps_fmu.cosim.UsageError` for a value that is not of the variable's type.
    """
    port = port_of(name)
    component = system.component(port.component)
    variable = variable_of(read_description(component.source), port.variable)
    if (given := component.parameters.get(port.variable)) is not None:
        try:
            return typed_value(variable, given.value)
        except UsageError as error:
            raise UsageError(f"{name} ({given.origin}): {error}") from error
    text = str(variable.start)
    if variable.type == "Boolean":
        return text in ("true", "1")
    return float(text) if variable.type == "Real" else text


def real_start(system: System, name: str) -> float:
    """:func:`start_value` of a number."""
    return float(start_value(system, name))


def given_parameters(options: RunOptions, system: System) -> dict[str, object]:
    """Options and all values that differ from those of the FMUs, for report and summary."""
    given: dict[str, object] = {
        "scenario": options.scenario,
        "duration (s)": options.duration_s,
        "step (s)": options.step_s,
        "storage step (s)": options.storage_s,
        "scheme": options.scheme,
    }
    for component in system.components:
        given |= {f"{component.name}.{name}": entry.value for name, entry in component.parameters.items()}
    return given


def fmu_files(system: System) -> tuple[FmuFile, ...]:
    """Name and SHA-256 of each FMU of the system."""
    return tuple(FmuFile.of(component.source) for component in system.components)


def _without_aliases(system: System, step_s: float) -> System:
    port = port_of(HIGHEST_NOISE)
    if port.variable in system.component(port.component).parameters or not start_value(system, NOISE):
        return system
    highest = HIGHEST_PER_RATE / step_s
    if highest >= real_start(system, HIGHEST_NOISE):
        return system
    print(
        f"The noise ends at {highest:g} Hz: a step of {step_s:g} s would fold what is above down to low "
        f"frequencies ({HIGHEST_NOISE} in a parameter file overrides this).",
        file=sys.stderr,
    )
    return system.with_parameters({HIGHEST_NOISE: highest})
