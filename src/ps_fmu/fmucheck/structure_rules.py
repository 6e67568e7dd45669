"""Rules for ModelStructure: who is listed, in which order, and what depends on what."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from itertools import pairwise

from .reading import Description, Variable, index_of
from .variable_rules import initial_of

Found = Iterator[tuple[int, str]]
_PARTS = ("Outputs", "Derivatives", "InitialUnknowns")
_KINDS = {part: ("dependent", "constant", "fixed", "tunable", "discrete") for part in _PARTS} | {
    "InitialUnknowns": ("dependent", "constant")
}


def outputs(description: Description) -> Found:
    """Outputs lists every output once, and nothing else."""
    wanted = [v for v in description.variables if v.causality == "output"]
    yield from _list_differs(description, "Outputs", wanted)


def derivatives(description: Description) -> Found:
    """Derivatives lists variables that are derivatives."""
    for unknown in description.unknowns("Derivatives"):
        variable = description.variable(unknown.index)
        if variable is None or "derivative" not in variable.attributes:
            yield unknown.line, f"Derivatives: index {unknown.index} is no variable with the attribute derivative"


def initial_unknowns(description: Description) -> Found:
    """InitialUnknowns lists outputs, states and derivatives that are not exact, and all calculated parameters."""
    dynamic = set()
    for unknown in description.unknowns("Derivatives"):
        variable = description.variable(unknown.index)
        if variable is not None:
            dynamic |= {variable.index, index_of(variable.attributes.get("derivative"))}
    wanted = [
        v
        for v in description.variables
        if v.causality == "calculatedParameter"
        or ((v.causality == "output" or v.index in dynamic) and initial_of(v) in ("approx", "calculated"))
    ]
    yield from _list_differs(description, "InitialUnknowns", wanted)


def initial_order(description: Description) -> Found:
    """InitialUnknowns ascends by index."""
    for first, second in pairwise(description.unknowns("InitialUnknowns")):
        if first.index > second.index:
            yield second.line, f"InitialUnknowns: index {second.index} comes after {first.index}, expected ascending"


def dependencies(description: Description) -> Found:
    """What an unknown depends on is known: inputs, time, and states or, in InitialUnknowns, exact variables."""
    states = {index_of(v.attributes.get("derivative")) for v in description.variables}
    for part in _PARTS:
        for unknown in description.unknowns(part):
            for index in unknown.dependencies or ():
                known = description.variable(index)
                if known is None:
                    yield unknown.line, f"{part}: unknown {unknown.index} depends on {index}, which is no index"
                elif not _is_known(known, part, states):
                    text = f"depends on {known.name} ({known.causality}), which is not known there"
                    yield unknown.line, f"{part}: unknown {unknown.index} {text}"


def dependencies_order(description: Description) -> Found:
    """Dependencies ascend by index."""
    for part in _PARTS:
        for unknown in description.unknowns(part):
            if any(first >= second for first, second in pairwise(unknown.dependencies or ())):
                yield unknown.line, f"{part}: the dependencies of unknown {unknown.index} do not ascend"


def dependencies_kind(description: Description) -> Found:
    """dependenciesKind has one allowed word for each dependency; other than ``dependent`` they are for Reals."""
    for part in _PARTS:
        for unknown in description.unknowns(part):
            if unknown.kinds is None:
                continue
            if unknown.dependencies is None or len(unknown.kinds) != len(unknown.dependencies):
                yield unknown.line, f"{part}: unknown {unknown.index}: not one dependenciesKind for each dependency"
            variable = description.variable(unknown.index)
            factors = variable is None or variable.type == "Real"
            for kind in unknown.kinds:
                if kind not in _KINDS[part] or not (factors or kind == "dependent"):
                    yield unknown.line, f"{part}: unknown {unknown.index}: dependenciesKind {kind!r} is not allowed"


def _is_known(variable: Variable, part: str, states: set[int]) -> bool:
    if variable.causality in ("input", "independent"):
        return True
    if part == "InitialUnknowns":
        return initial_of(variable) == "exact"
    return variable.index in states


def _list_differs(description: Description, part: str, wanted: list[Variable]) -> Found:
    structure = description.root.find("ModelStructure")
    line = structure.line if structure is not None else description.root.line
    listed = Counter(unknown.index for unknown in description.unknowns(part))
    for variable in wanted:
        if variable.index not in listed:
            yield line, f"{part}: {variable.name} (index {variable.index}) is missing"
    allowed = {variable.index for variable in wanted}
    for unknown in description.unknowns(part):
        variable_there = description.variable(unknown.index)
        name = variable_there.name if variable_there is not None else "no variable"
        if unknown.index not in allowed:
            yield unknown.line, f"{part}: index {unknown.index} ({name}) does not belong here"
        elif listed[unknown.index] > 1:
            yield unknown.line, f"{part}: {name} (index {unknown.index}) is listed more than once"
