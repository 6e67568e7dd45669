"""What a study varies: parameters, inputs and numbers of faults, found in the system; distributions of their values."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

import numpy as np
from fmpy.model_description import ModelDescription, ModelVariable
from numpy.typing import ArrayLike, NDArray

from ..cosim import CosimError, UsageError, Value
from ..cosim.conversion import has_exact_start
from ..cosim.description import convert_value, explain_unsettable, get_unit, index_variables, read_start
from ..cosim.faults.numbers import find_number
from ..cosim.graph import Wiring
from ..cosim.signals import bind_signals, convert_input
from ..cosim.structure import split_port, suggest_names
from ..cosim.values import list_items
from ..requirements.quantity import Quantity, parse_quantity
from ..runs.system import RunSystem
from ..theory.sampled import ON_STEP
from .study import NORMAL, STEPS, UNIFORM, VALUES, Branch, Vary

PREFIX = "faults."
Array = NDArray[np.float64]
LEAST_SHARE = 1e-9
"""Probability that a normal distribution must have between its limits."""


def names_faults(name: str, components: Collection[str]) -> bool:
    """Whether a name is one of a number of faults: of a component of this name it is a parameter."""
    return name.startswith(PREFIX) and PREFIX[:-1] not in components


def find_numbers(vary: Vary, system: RunSystem) -> dict[str, ModelVariable]:
    """The numbers that a ``[[vary]]`` sets, by name: one for one number.  Raises :class:`.study.StudyError`."""
    if system.faults is None:
        raise vary.error("parameter", f"{vary.parameter[0]} is a number of faults: [study] has no key faults")
    if vary.only:
        raise vary.error("only", "is for parameters of components, and not for numbers of faults")
    found: dict[str, ModelVariable] = {}
    for name in vary.parameter:
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


@dataclass(frozen=True)
class Spread:
    """A continuous distribution: uniform, or normal, truncated at ``low`` and ``high``; in the unit of the factor."""

    low: float
    high: float
    mean: float = 0.0
    sigma: float = 0.0
    """0: uniform."""
    multiple_of: float = 0.0
    """Values are rounded to the nearest multiple of it that is between ``low`` and ``high``; 0: they are not."""

    def quantile(self, share: ArrayLike) -> Array:
        """Values below which ``share`` (n,), between 0 and 1, of the distribution lies."""
        u = np.clip(np.asarray(share, dtype=float), 2.0**-53, 1.0 - 2.0**-53)  # a sample may have 0: no end of a normal
        if not self.sigma:
            return self._round(self.low + u * (self.high - self.low))
        from scipy.stats import truncnorm

        return self._round(truncnorm.ppf(u, *self._ends, loc=self.mean, scale=self.sigma))

    def _round(self, values: ArrayLike) -> Array:
        if not self.multiple_of:
            return np.asarray(values)
        first, last = self.multiples
        return np.asarray(np.clip(np.round(np.asarray(values) / self.multiple_of), first, last) * self.multiple_of)

    @property
    def multiples(self) -> tuple[float, float]:
        """The first and the last multiple between ``low`` and ``high``, in numbers of :attr:`multiple_of`."""
        low, high = self.low / self.multiple_of, self.high / self.multiple_of
        return math.ceil(low - ON_STEP) if math.isfinite(low) else low, (
            math.floor(high + ON_STEP) if math.isfinite(high) else high
        )

    @property
    def deviation(self) -> float:
        """Standard deviation."""
        if not self.sigma:
            return (self.high - self.low) / math.sqrt(12.0)
        from scipy.stats import truncnorm

        return float(truncnorm.std(*self._ends, scale=self.sigma))

    @property
    def _ends(self) -> tuple[float, float]:
        return (self.low - self.mean) / self.sigma, (self.high - self.mean) / self.sigma


@dataclass(frozen=True)
class Factor:
    """One degree of freedom of a plan.  It has a draw in each case: a number in the unit of its first target."""

    vary: Vary
    unit: str
    targets: tuple[str, ...]
    """``component.parameter`` of each start value that it sets, or ``faults.EVENT.key`` of each number of faults."""
    ratios: tuple[float, ...]
    """Value of each target over the draw: 1, or the ratio of what they start with where the spread is relative."""
    levels: tuple[Value, ...]
    """The values there are; empty for a continuous distribution."""
    spread: Spread | None
    """None where there are levels."""
    variables: tuple[ModelVariable, ...] = ()
    """Those that the targets are, with type, unit and bounds."""

    @property
    def name(self) -> str:
        """As the study calls it."""
        return self.vary.name

    @property
    def shown(self) -> tuple[str, float]:
        """The unit in which the study states its values, and the factor into it from that of the draws."""
        given = [number for key, number in self.vary.numbers.items() if key != "relative"]
        with suppress(ValueError):
            given += [parse_quantity(value) for value in self.vary.values[:1]]
        for unit in (number.unit for number in given if number.unit):
            with suppress(ValueError):
                return unit, 1.0 / Quantity(1.0, unit).to(self.unit)
        return self.unit, 1.0

    def draw(self, share: Array) -> Array:
        """Draws (n,) for shares (n,) between 0 and 1; levels have equal shares."""
        if self.spread is not None:
            return self.spread.quantile(share)
        places = np.minimum((share * len(self.levels)).astype(int), len(self.levels) - 1)
        return self.numbers[places]

    @property
    def has_texts(self) -> bool:
        """Whether levels are texts, which have no order."""
        return any(isinstance(level, str) for level in self.levels)

    @property
    def numbers(self) -> Array:
        """Draws (levels,) that stand for the levels: their values, or their places where they are texts."""
        texts = self.has_texts
        return np.array([place if texts else float(level) for place, level in enumerate(self.levels)], dtype=float)

    @property
    def deviation(self) -> float:
        """Standard deviation of the draws."""
        return float(self.numbers.std()) if self.spread is None else self.spread.deviation

    def values(self, draw: float) -> dict[str, Value]:
        """Start values by target."""
        if self.spread is None:
            level = self.levels[int(np.flatnonzero(self.numbers == draw)[0])]
            return dict.fromkeys(self.targets, level)
        return {name: draw * ratio for name, ratio in zip(self.targets, self.ratios, strict=True)}


def find_factor(vary: Vary, system: RunSystem, wiring: Wiring, branch: Branch | None = None) -> Factor:
    """The factor of a ``[[vary]]`` in a system, whose runs begin at a checkpoint where there is a ``branch``.

    Raises :class:`.study.StudyError`: an unknown parameter (with near names), one that cannot be set, is connected, or
    is in the state of a checkpoint, targets of different units, an impossible distribution.
    """
    if any(names_faults(name, system.descriptions) for name in vary.parameter):
        numbers = find_numbers(vary, system)
        stated = [float(read_start(number)) if number.type == "Real" else 0.0 for number in numbers.values()]
        return _make_factor(vary, tuple(numbers), tuple(numbers.values()), stated)
    targets = find_targets(vary, system.descriptions, _list_inputs(vary, system))
    variables = _find_variables(vary, targets, system, wiring, branch)
    pairs = zip(targets, variables, strict=True)
    starts = [system.get_number(name) if variable.type == "Real" else 0.0 for name, variable in pairs]
    return _make_factor(vary, targets, variables, starts)


def _find_variables(
    vary: Vary, targets: Sequence[str], system: RunSystem, wiring: Wiring, branch: Branch | None
) -> tuple[ModelVariable, ...]:
    why_not = explain_fed(system, wiring)
    variables = []
    for name in targets:
        if name in why_not:
            raise vary.error("parameter", f"{name} {why_not[name]}: a start value would have no effect")
        component, variable = system.structure.find_port(name)
        variables.append(index_variables(system.descriptions[component])[variable])
        if branch is not None and branch.keeps(name, system.descriptions):
            raise vary.error(
                "parameter",
                f"{name} is a fixed parameter: it is in the state of its FMU at the checkpoint, and no case can have "
                f"another.  Vary inputs and tunable parameters, or have this FMU begin anew, without its state: "
                f"[from], anew = [{component!r}]",
            )
    return tuple(variables)


def explain_fed(system: RunSystem, wiring: Wiring) -> dict[str, str]:
    """Why a start value of ``component.variable`` would count for nothing, of all that something else feeds."""
    connected = {str(connection.target): f"is connected to {connection.source}" for connection in wiring.connections}
    signals = bind_signals(system.structure, system.descriptions, system.inputs)
    return connected | {
        str(port): f"gets {signal.port} of the file of inputs" for signal in signals for port, _ in signal.targets
    }


def explain_unvaried(variable: ModelVariable) -> str | None:
    """Why a case cannot give a variable a start value; None if it can."""
    return None if has_exact_start(variable) else explain_unsettable(variable, running=False)


def _make_factor(
    vary: Vary, targets: tuple[str, ...], variables: tuple[ModelVariable, ...], starts: Sequence[float]
) -> Factor:
    """``starts``: what Real targets begin with where nothing is varied."""
    units = {get_unit(variable) or "1" for variable in variables}
    kinds = {variable.type for variable in variables}
    if len(units | kinds) > 2:
        raise vary.error("parameter", f"{', '.join(targets)} have different types or units: use a [[vary]] for each")
    unit = units.pop()
    if vary.distribution in (VALUES, STEPS):
        levels = _find_levels(vary, variables, unit)
        return Factor(vary, unit, targets, (1.0,) * len(targets), levels, None, variables)
    if kinds != {"Real"}:
        raise vary.error("distribution", f"{targets[0]} is of the type {kinds.pop()}: give a list of values")
    ratios = _find_ratios(vary, targets, starts)
    spread = _find_spread(vary, starts[0], unit)
    if "multiple_of" in vary.numbers:
        spread = _round_spread(vary, spread, unit)
    return Factor(vary, unit, targets, ratios, (), spread, variables)


def _round_spread(vary: Vary, spread: Spread, unit: str) -> Spread:
    """The spread whose values are multiples.  Raises :class:`.study.StudyError` if it has none."""
    size = _convert(vary, "multiple_of", unit)
    if not size > 0.0:
        raise vary.error("multiple_of", f"expected a number above 0, got {vary.numbers['multiple_of']}")
    found = replace(spread, multiple_of=size)
    first, last = found.multiples
    if first > last:
        ends = f"{spread.low:g} and {spread.high:g} {unit}"
        raise vary.error("multiple_of", f"there is no multiple of {vary.numbers['multiple_of']} between {ends}")
    return found


def _list_inputs(vary: Vary, system: RunSystem) -> dict[str, tuple[str, ...]]:
    """The ``component.variable`` that an input of the system leads to, of those that a ``[[vary]]`` names.

    Raises :class:`.study.StudyError` for one whose value is converted on its way.
    """
    found: dict[str, tuple[str, ...]] = {}
    for item in system.structure.inputs:
        if item.name in vary.parameter:
            for port, conversion in convert_input(system.structure, item, system.descriptions)[1]:
                if not conversion.changes_nothing:
                    text = f"the value of the system's input {item.name!r} is converted for {port}: vary {port} instead"
                    raise vary.error("parameter", text)
            found[item.name] = tuple(str(port) for port, _ in item.targets)
    return found


def find_targets(
    vary: Vary, descriptions: Mapping[str, ModelDescription], inputs: Mapping[str, Sequence[str]]
) -> tuple[str, ...]:
    """``component.parameter`` of each start value that a ``[[vary]]`` sets.

    A name that begins with that of a component is exact; one of ``inputs`` means all that it leads to; others are
    sought among the parameters and inputs of all components, or of those of ``only``.
    """
    for component in vary.only:
        if component not in descriptions:
            hint = suggest_names(component, descriptions) or f"; the system has {', '.join(descriptions)}"
            raise vary.error("only", f"there is no component {component!r}{hint}")
    settable = {
        component: [name for name, found in index_variables(description).items() if _is_settable(found)]
        for component, description in descriptions.items()
    }
    found: dict[str, None] = {}
    for name in vary.parameter:
        port = split_port(name, settable)
        variables = {} if port is None else index_variables(descriptions[port.component])
        if port is not None and port.variable in variables:
            if reason := explain_unvaried(variables[port.variable]):
                near = suggest_names(name, (f"{port.component}.{other}" for other in settable[port.component]))
                raise vary.error("parameter", f"{name} {reason}{near}")
            if vary.only:
                raise vary.error("only", f"{name!r} names its component already")
            found[name] = None
            continue
        if name in inputs and not vary.only:
            found |= dict.fromkeys(inputs[name])
            continue
        wanted = vary.only or tuple(settable)
        own = [f"{component}.{name}" for component in wanted if name in settable[component]]
        if not own:
            exact = [f"{component}.{other}" for component, others in settable.items() for other in others]
            known = exact if port is not None else dict.fromkeys(n for c in wanted for n in settable[c])
            near = suggest_names(name, known)
            where = f"the components {', '.join(vary.only)} have" if vary.only else "the system has"
            raise vary.error("parameter", f"{where} no parameter or input {name!r}{near}")
        found |= dict.fromkeys(own)
    return tuple(found)


def _is_settable(variable: ModelVariable) -> bool:
    return explain_unsettable(variable, running=False) is None


def _find_levels(vary: Vary, variables: Sequence[ModelVariable], unit: str) -> tuple[Value, ...]:
    if vary.distribution == STEPS:
        low, high = _convert(vary, "low", unit), _convert(vary, "high", unit)
        _check_width(vary, low, high)
        if vary.count > 1 and low >= high:
            raise vary.error("low", f"{vary.numbers['low']} is not below high, {vary.numbers['high']}")
        if vary.spacing == "log" and low <= 0.0:
            raise vary.error("low", "steps of a constant ratio need a low end above 0")
        steps = np.geomspace(low, high, vary.count) if vary.spacing == "log" else np.linspace(low, high, vary.count)
        given: list[object] = steps.tolist()
        if variables[0].type == "Integer":
            given = [int(step) if step.is_integer() else step for step in steps.tolist()]
    else:
        given = [_read_level(vary, level, variables[0].type, unit) for level in vary.values]
    found = []
    for level in given:
        for variable in variables:
            try:
                value = convert_level(variable, level)  # type: ignore[arg-type]
            except (UsageError, OverflowError) as error:
                raise vary.error("values" if vary.values else "low", f"{variable.name}: {error}") from None
        found.append(value)
    return tuple(found)


def convert_level(variable: ModelVariable, value: Value) -> Value:
    """A value as the variable takes it; of an enumeration the name of an item will do.

    Raises :class:`..cosim.UsageError`, without the name of the variable.
    """
    declared = variable.declaredType
    if variable.type != "Enumeration" or declared is None or not declared.items:
        return convert_value(variable, value)
    items = {item.name: int(item.value) for item in declared.items}
    if isinstance(value, str) and value in items:
        return items[value]
    if isinstance(value, str) or convert_value(variable, value) not in items.values():
        raise UsageError(f"the enumeration has no value {value!r}; it has {list_items(items)}")
    return value


def _read_level(vary: Vary, level: object, kind: str, unit: str) -> object:
    if kind != "Real":
        return level
    try:
        return parse_quantity(level).to(unit)
    except ValueError as error:
        raise vary.error("values", str(error)) from None


def _convert(vary: Vary, key: str, unit: str) -> float:
    try:
        return vary.numbers[key].to(unit)
    except ValueError as error:
        raise vary.error(key, str(error)) from None


def _find_ratios(vary: Vary, targets: Sequence[str], starts: Sequence[float]) -> tuple[float, ...]:
    if "relative" not in vary.numbers or "mean" in vary.numbers:
        return (1.0,) * len(targets)
    for name, start in zip(targets, starts, strict=True):
        if start == 0.0:
            raise vary.error("relative", f"{name} starts with 0: say in its unit how far it spreads")
    return tuple(start / starts[0] for start in starts)


def _check_width(vary: Vary, low: float, high: float) -> None:
    if not math.isfinite(high - low):
        ends = f"{vary.numbers['high']} is too far from low, {vary.numbers['low']}"
        raise vary.error("high", f"{ends}: expected a finite difference")


def _find_spread(vary: Vary, start: float, unit: str) -> Spread:
    number: Mapping[str, Quantity] = vary.numbers
    centre = _convert(vary, "mean", unit) if "mean" in number else start
    width = 0.0
    if "relative" in number or "sigma" in number:
        key = "relative" if "relative" in number else "sigma"
        width = abs(centre) * _convert(vary, key, "1") if key == "relative" else _convert(vary, key, unit)
        if not width > 0.0:
            raise vary.error(key, f"expected a spread above 0, got {number[key]}")
    if vary.distribution == UNIFORM and "relative" in number:
        return Spread(centre - width, centre + width)
    low = _convert(vary, "low", unit) if "low" in number else -math.inf
    high = _convert(vary, "high", unit) if "high" in number else math.inf
    if low >= high:
        raise vary.error("low", f"{number['low']} is not below high, {number['high']}")
    if vary.distribution == UNIFORM:
        _check_width(vary, low, high)
        return Spread(low, high)
    assert vary.distribution == NORMAL
    from scipy.stats import norm

    with np.errstate(over="ignore"):  # a limit that is too many sigmas away is as good as none
        share = norm.cdf(high, centre, width) - norm.cdf(low, centre, width)
    if share < LEAST_SHARE:
        about = f"{centre:g}" if unit == "1" else f"{centre:g} {unit}"
        text = f"a normal distribution about {about} with a sigma of {width:g} has nothing between {low:g} and {high:g}"
        raise vary.error("low", text)
    return Spread(low, high, centre, width)
