"""Numbers of faults as what a study varies: ``faults.EVENT.value``, beside parameters and inputs of FMUs."""

from __future__ import annotations

from collections.abc import Collection, Mapping

from fmpy.model_description import ModelVariable

from ..cosim import CosimError, Value
from ..cosim.faults.numbers import find_number
from ..runs.setup import RunSystem
from .study import Vary

PREFIX = "faults."


def names_faults(name: str, components: Collection[str]) -> bool:
    """Whether a name is one of a number of faults: of a component of this name it is a parameter."""
    return name.startswith(PREFIX) and PREFIX[:-1] not in components


def find_numbers(vary: Vary, system: RunSystem) -> dict[str, ModelVariable]:
    """The numbers that a ``[[vary]]`` sets, by name: one for one number.  Raises :class:`.study.StudyError`."""
    if system.faults is None:
        raise vary.error("parameter", f"{vary.parameters[0]} is a number of faults: [study] has no key faults")
    if vary.only:
        raise vary.error("only", "is for parameters of components, and not for numbers of faults")
    found: dict[str, ModelVariable] = {}
    for name in vary.parameters:
        if not names_faults(name, system.descriptions):
            raise vary.error("parameter", f"{name} is no number of faults: use a [[vary]] for each")
        try:
            number = find_number(system.faults, name.removeprefix(PREFIX), system.descriptions)
        except CosimError as error:
            raise vary.error("parameter", f"{name}: {error}") from error
        found[f"{PREFIX}{number.name}"] = number
    return found


def split_values(
    values: Mapping[str, Value], components: Collection[str]
) -> tuple[dict[str, Value], dict[str, Value]]:
    """What a case sets: start values; numbers of faults, for :func:`..cosim.faults.numbers.change_numbers`."""
    starts: dict[str, Value] = {}
    numbers: dict[str, Value] = {}
    for name, value in values.items():
        if names_faults(name, components):
            numbers[name.removeprefix(PREFIX)] = value
        else:
            starts[name] = value
    return starts, numbers
