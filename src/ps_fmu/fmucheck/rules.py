"""The rules of FMI 2.0.4 for a ``modelDescription.xml`` that neither the schema nor FMPy checks, or that tools miss.

One table, one function per rule; the docstring of the function is what must hold.  Each rule names the section of the
standard that it comes from, by the numbers in the published text of FMI 2.0.4.  Where a rule with the verdict
"warning" is broken, importers still get on, and the other checkers accept the FMU.

All rules of VDMCheck for this file are among them but one that the text does not have: a variable may have wider bounds
than its declared type (section 2.2.7: "the min of ScalarVariable is actually used").
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import islice

from . import model_rules, structure_rules, variable_rules
from .reading import Description, Faults
from .verdicts import FAILED, WARNING, clean_line

MOST_PROBLEMS = 1000
"""Problems of one rule that are listed."""


@dataclass(frozen=True)
class DescriptionRule:
    """A rule of FMI 2.0.4 and its section; what finds the faults; the verdict on a description that has some."""

    name: str
    section: str
    find: Callable[[Description], Faults]
    verdict: str = FAILED


@dataclass(frozen=True)
class Problem:
    """A line of the file that breaks a rule."""

    rule: DescriptionRule
    line: int
    text: str

    def __str__(self) -> str:
        return f"line {self.line}: {self.text} [{self.rule.name}, FMI 2.0.4, section {self.rule.section}]"


DESCRIPTION_RULES = (
    DescriptionRule("encoding", "2.2", model_rules.check_encoding),
    DescriptionRule("version", "2.2.1", model_rules.check_version),
    DescriptionRule("guid", "2.2.1", model_rules.check_guid),
    DescriptionRule("date", "2.2.1", model_rules.check_date),
    DescriptionRule("interface", "2.2.1", model_rules.check_interface),
    DescriptionRule("identifier", "2.1.1", model_rules.check_identifier),
    DescriptionRule("capabilities", "4.3.1", model_rules.check_capabilities),
    DescriptionRule("source-files", "2.3", model_rules.check_source_files),
    DescriptionRule("units", "2.2.2", model_rules.check_unit_names),
    DescriptionRule("conversions", "2.2.2", model_rules.check_unit_conversions),
    DescriptionRule("base-units", "2.2.2", model_rules.check_base_units),
    DescriptionRule("display-units", "2.2.2", model_rules.check_display_names),
    DescriptionRule("display-conversions", "2.2.2", model_rules.check_display_units),
    DescriptionRule("types", "2.2.3", model_rules.check_types),
    DescriptionRule("type-units", "2.2.3", model_rules.check_type_units),
    DescriptionRule("type-bounds", "2.2.3", model_rules.check_type_bounds),
    DescriptionRule("enumerations", "2.2.3", model_rules.check_enumerations),
    DescriptionRule("log-categories", "2.2.4", model_rules.check_log_categories),
    DescriptionRule("experiment", "2.2.5", model_rules.check_experiment),
    DescriptionRule("vendor-annotations", "2.2.6", model_rules.check_vendor_annotations),
    DescriptionRule("names", "2.2.7", variable_rules.check_names),
    DescriptionRule("derivative-names", "2.2.9", variable_rules.check_derivative_names),
    DescriptionRule("references", "2.2.7", variable_rules.check_references),
    DescriptionRule("combination", "2.2.7", variable_rules.check_combination),
    DescriptionRule("initial", "2.2.7", variable_rules.check_initial),
    DescriptionRule("start", "2.2.7", variable_rules.check_start),
    DescriptionRule("continuous", "2.2.7", variable_rules.check_continuous),
    DescriptionRule("independent", "2.2.7", variable_rules.check_independent),
    DescriptionRule("finite", "2.2", variable_rules.check_finite),
    DescriptionRule("values", "2.2.3", variable_rules.check_values),
    DescriptionRule("bounds", "2.2.3", variable_rules.check_bounds),
    DescriptionRule("declared-type", "2.2.7", variable_rules.check_declared_type),
    DescriptionRule("unit", "2.2.3", variable_rules.check_unit),
    DescriptionRule("display-unit", "2.2.3", variable_rules.check_display_unit),
    DescriptionRule("derivative", "2.2.7", variable_rules.check_derivative),
    DescriptionRule("model-exchange", "2.2.7", variable_rules.check_model_exchange),
    DescriptionRule("outputs", "2.2.8", structure_rules.check_outputs),
    DescriptionRule("derivatives", "2.2.8", structure_rules.check_derivatives),
    DescriptionRule("initial-unknowns", "2.2.8", structure_rules.check_initial_unknowns),
    DescriptionRule("initial-order", "2.2.8", structure_rules.check_initial_order),
    DescriptionRule("dependencies", "2.2.8", structure_rules.check_dependencies),
    DescriptionRule("dependencies-known", "2.2.8", structure_rules.check_known, WARNING),
    DescriptionRule("dependencies-order", "2.2.8", structure_rules.check_dependencies_order),
    DescriptionRule("dependencies-kind", "2.2.8", structure_rules.check_dependencies_kind),
    DescriptionRule("dependencies-factor", "2.2.8", structure_rules.check_factors, WARNING),
)


def check_description(description: Description) -> list[Problem]:
    """What breaks the rules in a model description, at most :data:`MOST_PROBLEMS` for each rule."""
    return [
        Problem(rule, line, clean_line(text))
        for rule in DESCRIPTION_RULES
        for line, text in islice(rule.find(description), MOST_PROBLEMS)
    ]
