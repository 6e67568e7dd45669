"""A scheme for one system: rates from what its files state, and whether its FMUs can do what the scheme asks for."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from math import lcm

from fmpy.model_description import ModelDescription

from ..errors import UsageError
from ..graph import find_strong_groups
from ..structure import System
from ..substeps import find_obstacle
from ..values import parse_real
from .scheme import Rate, Scheme, find_rate

log = logging.getLogger("ps_fmu.cosim")

MOST_PHASES = 1000
"""Base steps after which rates have to come round."""


def resolve_scheme(
    scheme: Scheme, system: System, descriptions: Mapping[str, ModelDescription], step: float
) -> Scheme:
    """The scheme with the rates that the system or its FMUs state, where the scheme gives none.

    Stated are: the annotation ``osp:StepSizeHint`` of a component; the default step of an FMU that takes steps of one
    size only.  One that is no whole multiple or fraction of the base step [s] is named in a warning.  What is resolved
    stays as it is when it is resolved again.

    Raises :class:`UsageError`, with the component: a scheme that its FMUs cannot follow.
    """
    for name in scheme.rates:
        system.component(name)
    rates = dict(scheme.rates)
    for component in system.components:
        stated = component.step or _find_own_step(descriptions[component.name])
        if stated is not None and component.name not in rates:
            rate = find_rate(stated, step)
            rates[component.name] = rate or Rate()
            if rate is None:
                log.warning(
                    "%s: its step of %.9g s is not a whole multiple or fraction of the step of %.9g s, which is used",
                    component.name, stated, step,
                )  # fmt: skip
    scheme = replace(scheme, rates=rates)
    period = find_period(scheme)
    if period > MOST_PHASES:
        raise UsageError(f"rates come round after {period} base steps: expected at most {MOST_PHASES}")
    _check_estimate(scheme, descriptions)
    _check_iteration(scheme, system, descriptions)
    return scheme


def find_period(scheme: Scheme) -> int:
    """Base steps after which the same components begin a step together again."""
    return lcm(*(rate.steps for rate in scheme.rates.values()))


def find_loops(names: Sequence[str], pairs: Sequence[tuple[str, str]]) -> list[tuple[list[str], bool]]:
    """Components in the order in which they see one another; those of a loop together, and whether they are one."""
    return [(group, len(group) > 1 or (group[0], group[0]) in pairs) for group in find_strong_groups(names, pairs)]


def list_loops(system: System) -> list[tuple[str, ...]]:
    """The components of each loop."""
    pairs = [(c.source.component, c.target.component) for c in system.connections]
    names = [component.name for component in system.components]
    return [tuple(group) for group, looped in find_loops(names, pairs) if looped]


def explain_no_repeat(scheme: Scheme, descriptions: Mapping[str, ModelDescription]) -> str | None:
    """Why a discarded step cannot be made again in parts; None if it can."""
    if scheme.is_plain:
        return find_obstacle(descriptions)
    return "the scheme has rates, extrapolates, iterates or estimates errors"


def _find_own_step(description: ModelDescription) -> float | None:
    """The step [s] of an FMU that takes steps of one size only; None if it takes others, or states none."""
    own = description.defaultExperiment
    if description.coSimulation.canHandleVariableCommunicationStepSize or own is None or own.stepSize is None:
        return None
    step = parse_real(str(own.stepSize))
    return step if step is not None and step > 0.0 else None


def _check_estimate(scheme: Scheme, descriptions: Mapping[str, ModelDescription]) -> None:
    if not scheme.error_estimate:
        return
    for name, rate in scheme.rates.items():
        if rate == Rate():
            continue
        raise UsageError(
            f"error estimate: half steps need one step for all components, but {name} has the rate {rate}: give it 1"
        )
    if obstacle := find_obstacle(descriptions):
        raise UsageError(f"error estimate: half steps cannot be made: {obstacle}")


def _check_iteration(scheme: Scheme, system: System, descriptions: Mapping[str, ModelDescription]) -> None:
    for members in list_loops(system) if scheme.is_iterated else ():
        for name in members:
            where = f"iterated: {name} in the loop of {', '.join(members)}"
            if not descriptions[name].coSimulation.canGetAndSetFMUstate:
                raise UsageError(
                    f"{where} cannot be set back to a state (canGetAndSetFMUstate is false): take jacobi or "
                    "gauss-seidel"
                )
            if (rate := scheme.get_rate(name)) != Rate():
                text = "components of a loop are iterated with the base step: give it the rate 1"
                raise UsageError(f"{where} has the rate {rate}: {text}")
