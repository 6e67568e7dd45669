"""Whether the components of a system describe one mechanism: parameters of one name that have different values.

The plant is the truth.  A parameter of another component that has the name of one of the plant's states what that
component knows of the plant: joints and legs, the payload, the centre of mass of the bus.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from fmpy.model_description import ModelDescription, ModelVariable

from ..cosim import Value
from ..cosim.description import get_unit, index_variables, read_start

REFERENCE = "plant"
"""The component that the others describe."""
APART = "ps_fmu.apart"
"""Type of the annotation at a value that is set apart from the plant's on purpose."""
SAME = 1e-9  # relative difference of numbers that are taken for one: more than what decimal digits lose

_COMPONENT = re.compile(r"\.(?:[tr]?[xyz]|[xyz]{2}|min|max)$")


@dataclass(frozen=True)
class Difference:
    """A quantity that a component has otherwise than the plant; a vector is one quantity."""

    component: str
    quantity: str
    """Its name without the axis: ``payload.com``."""
    variables: tuple[str, ...]
    own: tuple[Value, ...]
    of_plant: tuple[Value, ...]
    unit: str | None

    @property
    def relative(self) -> float:
        """Largest difference of a component over the largest component; 1 for values that are no numbers."""
        pairs = list(zip(self.own, self.of_plant, strict=True))
        if any(isinstance(value, bool | str) for pair in pairs for value in pair):
            return 1.0
        numbers = [(float(one), float(other)) for one, other in pairs]
        return max(abs(one - other) for one, other in numbers) / max(abs(value) for pair in numbers for value in pair)

    def __str__(self) -> str:
        return f"{self.quantity}: {_format(self.own, self.unit)}, the plant's {_format(self.of_plant, self.unit)}"


def find_differences(
    descriptions: Mapping[str, ModelDescription],
    get_value: Callable[[str], Value],
    is_meant: Callable[[str], bool],
) -> list[Difference]:
    """What the components have otherwise than the plant, in the order of the components and of their parameters.

    Not a quantity whose values are all those that both FMUs start with: known.  The paper's isolator has the centre of
    mass of the payload 9.5 mm off, which is in paper.toml.

    Parameters
    ----------
    descriptions: model description of each component.
    get_value: the start value of ``component.variable``.
    is_meant: whether ``component.variable`` is set apart on purpose.
    """
    if REFERENCE not in descriptions:
        return []
    truth = _list_parameters(descriptions[REFERENCE])
    found = []
    for component, description in descriptions.items():
        if component == REFERENCE:
            continue
        own = _list_parameters(description)
        shared = [name for name in own if name in truth and get_unit(own[name]) == get_unit(truth[name])]
        for quantity, variables in _group(shared):
            pairs = [(get_value(f"{component}.{name}"), get_value(f"{REFERENCE}.{name}")) for name in variables]
            starts = [(read_start(own[name]), read_start(truth[name])) for name in variables]
            meant = all(is_meant(f"{component}.{name}") for name in variables)
            if not meant and pairs != starts and not _agree(pairs):
                mine, others = zip(*pairs, strict=True)
                unit = get_unit(own[variables[0]])
                found.append(Difference(component, quantity, tuple(variables), mine, others, unit))
    return found


def _list_parameters(description: ModelDescription) -> dict[str, ModelVariable]:
    variables = index_variables(description)
    return {name: variable for name, variable in variables.items() if variable.causality == "parameter"}


def _group(names: Sequence[str]) -> Iterator[tuple[str, list[str]]]:
    """Names by the quantity that they are components of."""
    groups: dict[str, list[str]] = {}
    for name in names:
        groups.setdefault(_COMPONENT.sub("", name), []).append(name)
    return iter(groups.items())


def _agree(pairs: Sequence[tuple[Value, Value]]) -> bool:
    if any(isinstance(value, bool | str) for pair in pairs for value in pair):
        return all(one == other for one, other in pairs)
    size = max(abs(float(value)) for pair in pairs for value in pair)
    return all(abs(float(one) - float(other)) <= SAME * size for one, other in pairs)


def _format(values: Sequence[Value], unit: str | None) -> str:
    texts = [f"{value:.10g}" if isinstance(value, float) else str(value) for value in values]
    joined = texts[0] if len(texts) == 1 else f"({', '.join(texts)})"
    return joined if unit in (None, "1") else f"{joined} {unit}"
