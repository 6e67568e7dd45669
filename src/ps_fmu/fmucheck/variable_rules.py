"""Rules for ModelVariables: names, references, and which attributes go together."""

from __future__ import annotations

import math
from collections import Counter, defaultdict
from itertools import pairwise

from .reading import Description, Faults, Variable, parse_index, parse_number

_SPECIAL = ("INF", "+INF", "-INF", "NaN")

# The table of section 2.2.7: for each causality and variability what `initial` may be, the default first.
_A, _B, _C, _D = ("exact",), ("calculated", "approx"), ("calculated", "exact", "approx"), ()
INITIAL: dict[tuple[str, str], tuple[str, ...]] = {
    ("parameter", "fixed"): _A,
    ("parameter", "tunable"): _A,
    ("calculatedParameter", "fixed"): _B,
    ("calculatedParameter", "tunable"): _B,
    ("input", "discrete"): _D,
    ("input", "continuous"): _D,
    ("output", "constant"): _A,
    ("output", "discrete"): _C,
    ("output", "continuous"): _C,
    ("local", "constant"): _A,
    ("local", "fixed"): _B,
    ("local", "tunable"): _B,
    ("local", "discrete"): _C,
    ("local", "continuous"): _C,
    ("independent", "continuous"): _D,
}


def find_initial(variable: Variable) -> str | None:
    """The stated ``initial``, or the default of the table; None where there is none."""
    allowed = INITIAL.get((variable.causality, variable.variability), ())
    return variable.stated_initial or (allowed[0] if allowed else None)


def check_names(description: Description) -> Faults:
    """Each name is there once, and none is empty."""
    seen: dict[str, int] = {}
    for variable in description.variables:
        if not variable.name:
            yield variable.line, "a variable has no name"
        elif variable.name in seen:
            yield variable.line, f"the name {variable.name!r} is also in line {seen[variable.name]}"
        seen.setdefault(variable.name, variable.line)


def check_references(description: Description) -> Faults:
    """Variables with one value reference and type are one value: one of them can be set, all have one unit, ..."""
    shared: dict[tuple[str, str], list[Variable]] = defaultdict(list)
    for variable in description.variables:
        kind = "Integer" if variable.type == "Enumeration" else variable.type  # one pair of functions for both
        shared[kind, variable.reference].append(variable)
    for aliases in shared.values():
        constants = [a.start for a in aliases if a.variability == "constant"]
        problems = [
            ("more than one can be set", sum(map(_is_settable, aliases)) > 1),
            ("one can be set, another is independent",
             any(map(_is_settable, aliases)) and any(a.causality == "independent" for a in aliases)),
            ("more than one has a start value", sum(_has_start(a) for a in aliases) > 1),
            ("some are constant", 0 < len(constants) < len(aliases)),
            ("constants with different values", len(set(constants)) > 1),
            ("their units differ", len({a.attributes.get("unit") for a in aliases}) > 1),
        ]  # fmt: skip
        listed = ", ".join(a.name for a in aliases)
        for text, broken in problems:
            if broken:
                yield aliases[-1].line, f"value reference {aliases[0].reference} is that of {listed}: {text}"


def _is_settable(variable: Variable) -> bool:
    if variable.causality in ("input", "parameter"):
        return True
    return variable.variability != "constant" and find_initial(variable) in ("exact", "approx")


def _has_start(variable: Variable) -> bool:
    return variable.variability != "constant" and variable.start is not None


def check_combination(description: Description) -> Faults:
    """Causality and variability are a pair of the table."""
    for v in description.variables:
        if (v.causality, v.variability) not in INITIAL:
            yield v.line, f"{v.name}: causality {v.causality!r} does not go with variability {v.variability!r}"


def check_initial(description: Description) -> Faults:
    """``initial`` is one that the table allows; inputs and the independent variable have none."""
    for v in description.variables:
        allowed = INITIAL.get((v.causality, v.variability))
        if allowed is not None and v.stated_initial is not None and v.stated_initial not in allowed:
            expected = " or ".join(allowed) or "none"
            yield v.line, f"{v.name} ({v.variability} {v.causality}): initial {v.stated_initial!r}, expected {expected}"


def check_start(description: Description) -> Faults:
    """There is a start value where one is needed, and none where it is calculated."""
    for v in description.variables:
        needed = v.causality in ("input", "parameter") or v.variability == "constant"
        needed = needed or find_initial(v) in ("exact", "approx")
        if needed and v.start is None:
            yield v.line, f"{v.name}: a start value is missing"
        forbidden = v.causality == "independent" or (find_initial(v) == "calculated" and not needed)
        if forbidden and v.start is not None:
            yield v.line, f"{v.name}: the start value has no meaning, because the FMU calculates it"


def check_continuous(description: Description) -> Faults:
    """Only Reals are continuous, which is also the default."""
    for v in description.variables:
        if v.type != "Real" and v.variability == "continuous" and v.causality != "independent":
            yield v.line, f"{v.name}: the variability of a {v.type} cannot be continuous (the default): state another"


def check_independent(description: Description) -> Faults:
    """At most one variable is independent, and it is a Real."""
    found = [v for v in description.variables if v.causality == "independent"]
    for v in found[1:]:
        yield v.line, f"{v.name}: {found[0].name} is independent already"
    for v in found:
        if v.type != "Real":
            yield v.line, f"{v.name}: the independent variable is a {v.type}, expected a Real"


def check_finite(description: Description) -> Faults:
    """The file has no infinite numbers and no NaN."""
    for v in description.variables:
        for attribute in ("start", "min", "max", "nominal"):
            text = v.attributes.get(attribute, "")
            if v.type == "Real" and text.strip() in _SPECIAL:
                yield v.line, f"{v.name}: {attribute} {text!r} is not allowed in the file"


def check_values(description: Description) -> Faults:
    """start, min, max and nominal are values of the variable's type; nominal is positive."""
    for v in description.variables:
        for attribute in ("start", "min", "max", "nominal"):
            text = v.attributes.get(attribute)
            if text is None or v.type == "String" or (v.type == "Boolean" and text in ("true", "false", "0", "1")):
                continue
            if v.type == "Real" and text.strip() in _SPECIAL:
                continue  # is for the rule "finite"
            value = parse_number(text, v.type)
            if math.isnan(value) or (attribute == "nominal" and not value > 0.0):
                yield v.line, f"{v.name}: {attribute} {text!r} is not possible for a {v.type}"


def check_bounds(description: Description) -> Faults:
    """min <= start <= max."""
    for v in description.variables:
        low, value, high = v.number("min"), v.number("start"), v.number("max")
        given = [(name, x) for name, x in (("min", low), ("start", value), ("max", high)) if x is not None]
        for (name, smaller), (other, larger) in pairwise(given):
            if smaller > larger:
                yield v.line, f"{v.name}: {name} {smaller:g} is above {other} {larger:g}"


def check_declared_type(description: Description) -> Faults:
    """A declared type is defined, and of the variable's own kind."""
    kinds = {e.attributes.get("name"): {child.tag for child in e.children} for e in description.types}
    for v in description.variables:
        name = v.attributes.get("declaredType")
        if name is not None and v.type not in kinds.get(name, ()):
            yield v.line, f"{v.name}: there is no {v.type} type {name!r}"


def check_unit(description: Description) -> Faults:
    """A unit is defined in UnitDefinitions."""
    defined = {element.attributes.get("name") for element in description.units}
    for v in description.variables:
        name = v.attributes.get("unit")
        if name is not None and name not in defined:
            yield v.line, f"{v.name}: the unit {name!r} is not defined"


def check_display_unit(description: Description) -> Faults:
    """A display unit is one of the variable's unit."""
    displays = {
        element.attributes.get("name"): {d.attributes.get("name") for d in element.all("DisplayUnit")}
        for element in description.units
    }
    for v in description.variables:
        name, own = v.attributes.get("displayUnit"), v.attributes.get("unit")
        if name is None:
            continue
        if own is None:
            yield v.line, f"{v.name}: the display unit {name!r} has no unit"
        elif own in displays and name not in displays[own]:
            yield v.line, f"{v.name}: the unit {own!r} has no display unit {name!r}, which tools then ignore"


def check_derivative(description: Description) -> Faults:
    """The attribute ``derivative`` points from a continuous Real to another one, which it is the only one for."""
    states = Counter(v.attributes["derivative"] for v in description.variables if "derivative" in v.attributes)
    for v in description.variables:
        text = v.attributes.get("derivative")
        if text is None:
            continue
        state = description.variable(parse_index(text))
        if state is None or any((x.type, x.variability) != ("Real", "continuous") for x in (state, v)):
            yield v.line, f"{v.name}: derivative {text!r} is not the index of a continuous Real"
        elif states[text] > 1:
            yield v.line, f"{v.name}: {state.name} has more than one derivative"


def check_model_exchange(description: Description) -> Faults:
    """What is for model exchange only is not in a description without it: how often to set, what is set anew."""
    offered = description.root.find("ModelExchange") is not None
    states = {parse_index(v.attributes.get("derivative")) for v in description.variables}
    for v in description.variables:
        allowed = {
            "canHandleMultipleSetPerTimeInstant": (v.own, v.causality == "input", "inputs"),
            "reinit": (v.attributes, v.index in states, "continuous-time states"),
        }
        for attribute, (given, fits, expected) in allowed.items():
            if attribute in given and not (offered and fits):
                yield v.line, f"{v.name}: {attribute} is for {expected} in model exchange"


def check_derivative_names(description: Description) -> Faults:
    """Where names are structured, der(...) is the derivative of something, and so a Real."""
    if description.root.attributes.get("variableNamingConvention") != "structured":
        return
    for v in description.variables:
        if v.name.startswith("der(") and v.type != "Real":
            yield v.line, f"{v.name}: a derivative is a Real, this is of type {v.type}"
