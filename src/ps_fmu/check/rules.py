"""The rules of FMI 2.0.4 for a ``modelDescription.xml`` that neither the schema nor FMPy checks, or that tools miss.

One table, one function per rule.  Each rule names the section of the standard that it comes from.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from . import model_rules, structure_rules, variable_rules
from .reading import Description

Finder = Callable[[Description], Iterator[tuple[int, str]]]


@dataclass(frozen=True)
class Rule:
    """What must hold, where the standard (FMI 2.0.4) says so, and what finds the lines where it does not."""

    name: str
    section: str
    find: Finder


@dataclass(frozen=True)
class Problem:
    """A rule that is broken in a line of the file."""

    rule: Rule
    line: int
    text: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.text} [{self.rule.name}, FMI 2.0.4, {self.rule.section}]"


RULES = (
    Rule("version", "2.2.1", model_rules.version),
    Rule("guid", "2.2.1", model_rules.guid),
    Rule("date", "2.2.1", model_rules.date),
    Rule("interface", "2.2.1", model_rules.interface),
    Rule("identifier", "2.1.1", model_rules.identifier),
    Rule("units", "2.2.2", model_rules.unit_names),
    Rule("display-units", "2.2.2", model_rules.display_unit_names),
    Rule("types", "2.2.3", model_rules.type_names),
    Rule("enumerations", "2.2.3", model_rules.enumerations),
    Rule("log-categories", "2.2.4", model_rules.log_categories),
    Rule("experiment", "2.2.5", model_rules.experiment),
    Rule("names", "2.2.7", variable_rules.names),
    Rule("references", "2.2.7", variable_rules.references),
    Rule("combination", "2.2.7", variable_rules.combination),
    Rule("initial", "2.2.7", variable_rules.initial),
    Rule("start", "2.2.7", variable_rules.start),
    Rule("continuous", "2.2.7", variable_rules.continuous),
    Rule("independent", "2.2.7", variable_rules.independent),
    Rule("values", "2.2.7", variable_rules.values),
    Rule("bounds", "2.2.7", variable_rules.bounds),
    Rule("declared-type", "2.2.7", variable_rules.declared_type),
    Rule("unit", "2.2.7", variable_rules.unit),
    Rule("display-unit", "2.2.7", variable_rules.display_unit),
    Rule("derivative", "2.2.7", variable_rules.derivative),
    Rule("outputs", "2.2.8", structure_rules.outputs),
    Rule("derivatives", "2.2.8", structure_rules.derivatives),
    Rule("initial-unknowns", "2.2.8", structure_rules.initial_unknowns),
    Rule("initial-order", "2.2.8", structure_rules.initial_order),
    Rule("dependencies", "2.2.8", structure_rules.dependencies),
    Rule("dependencies-order", "2.2.8", structure_rules.dependencies_order),
    Rule("dependencies-kind", "2.2.8", structure_rules.dependencies_kind),
)


def check_description(description: Description) -> list[Problem]:
    """Everything in a model description that breaks one of :data:`RULES`."""
    return [Problem(rule, line, text) for rule in RULES for line, text in rule.find(description)]
