"""The rules of FMI 2.0.4 for a ``modelDescription.xml`` that neither the schema nor FMPy checks, or that tools miss.

One table, one function per rule.  Each rule names the section of the standard that it comes from, by the numbers in the
published text of FMI 2.0.4.  All rules of VDMCheck for this file are among them but one that the text does not have: a
variable may have wider bounds than its declared type (section 2.2.7: "the min of ScalarVariable is actually used").
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from . import model_rules, structure_rules, type_rules, unit_rules, variable_rules
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
    Rule("encoding", "2.2", model_rules.encoding),
    Rule("version", "2.2.1", model_rules.version),
    Rule("guid", "2.2.1", model_rules.guid),
    Rule("date", "2.2.1", model_rules.date),
    Rule("interface", "2.2.1", model_rules.interface),
    Rule("identifier", "2.1.1", model_rules.identifier),
    Rule("capabilities", "4.3.1", model_rules.capabilities),
    Rule("source-files", "2.3", model_rules.source_files),
    Rule("units", "2.2.2", unit_rules.names),
    Rule("conversions", "2.2.2", unit_rules.conversions),
    Rule("base-units", "2.2.2", unit_rules.base_units),
    Rule("display-units", "2.2.2", unit_rules.display_names),
    Rule("display-conversions", "2.2.2", unit_rules.display_units),
    Rule("types", "2.2.3", type_rules.names),
    Rule("type-units", "2.2.3", type_rules.units),
    Rule("type-bounds", "2.2.3", type_rules.bounds),
    Rule("enumerations", "2.2.3", type_rules.enumerations),
    Rule("log-categories", "2.2.4", model_rules.log_categories),
    Rule("experiment", "2.2.5", model_rules.experiment),
    Rule("vendor-annotations", "2.2.6", model_rules.vendor_annotations),
    Rule("names", "2.2.7", variable_rules.names),
    Rule("derivative-names", "2.2.9", variable_rules.derivative_names),
    Rule("references", "2.2.7", variable_rules.references),
    Rule("combination", "2.2.7", variable_rules.combination),
    Rule("initial", "2.2.7", variable_rules.initial),
    Rule("start", "2.2.7", variable_rules.start),
    Rule("continuous", "2.2.7", variable_rules.continuous),
    Rule("independent", "2.2.7", variable_rules.independent),
    Rule("finite", "2.2", variable_rules.finite),
    Rule("values", "2.2.3", variable_rules.values),
    Rule("bounds", "2.2.3", variable_rules.bounds),
    Rule("declared-type", "2.2.7", variable_rules.declared_type),
    Rule("unit", "2.2.3", variable_rules.unit),
    Rule("display-unit", "2.2.3", variable_rules.display_unit),
    Rule("derivative", "2.2.7", variable_rules.derivative),
    Rule("model-exchange", "2.2.7", variable_rules.model_exchange),
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
