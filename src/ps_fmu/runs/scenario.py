"""The scenarios: what can be run, and the options that suit it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fmpy.model_description import ModelVariable


ORIGINAL = "original"
"""The active case with the components of the system, where FMUs of the user replace them."""


@dataclass(frozen=True)
class Need:
    """A variable that a scenario sets or reads: a system whose component does not have it is refused."""

    name: str  # component.variable
    causality: str  # "input": the scenario sets it; "output" and "parameter": the scenario reads it
    type: str = "Real"  # of FMI
    purpose: str = ""  # why the scenario needs it, where the name does not say that

    def is_met_by(self, variable: ModelVariable | None) -> bool:
        """Whether a variable of the FMU is what the scenario needs."""
        return variable is not None and (variable.causality, variable.type) == (self.causality, self.type)

    @property
    def use(self) -> str:
        """What the scenario does with it."""
        return "sets" if self.causality == "input" else "reads"


def list_needs(causality: str, *names: str, type: str = "Real", purpose: str = "") -> Iterator[Need]:
    """Needs of one causality and type."""
    return (Need(name, causality, type, purpose) for name in names)


@dataclass(frozen=True)
class Scenario:
    """What can be run.

    Its module, imported when it runs, has ``find(run) -> Findings``: it runs the cases and returns what comes of
    them, prints nothing and draws nothing.  Its ``list_cases()`` names the runs, for requirements to name; a module
    in which only ``find`` knows them has none.  Its ``NEEDS`` are the variables that the system must have.  A study,
    which runs its cases itself, has no module.
    Times that are not a number are those of the system, see :func:`.setup.settle_times`.
    """

    name: str
    about: str  # one sentence, for --help
    module: str
    duration_s: float  # of one run
    step_s: float = 1e-4  # communication step
    storage_step_s: float = 1e-2  # between stored rows; a run of 100 s stored at each step of 1e-4 s takes 0.5 GB
    system: str = "SystemStructure.ssd"  # name of the product's system description
    cases: tuple[str, ...] = ()  # names of the runs of a study
    alone: bool = False  # single cases can be asked for
    compares: bool = False  # where FMUs replace components, the case :data:`ORIGINAL` is run, too
    seed: int | None = 1  # of the disturbance; None: that of the system
    foreign: bool = False  # takes any system, of whatever maker, as SSP says; else one with plant and disturbance

    def find_cases(self) -> tuple[str, ...]:
        """Names of the runs; empty where only ``find`` knows them."""
        if not self.module:
            return self.cases
        module = self.load()
        return tuple(module.list_cases()) if hasattr(module, "list_cases") else ()

    def find_needs(self) -> tuple[Need, ...]:
        """The variables that the scenario sets and reads; its module is imported."""
        return tuple(getattr(self.load(), "NEEDS", ())) if self.module else ()

    def load(self) -> Any:
        """Import the module."""
        return import_module(self.module)


SCENARIOS: Mapping[str, Scenario] = {
    scenario.name: scenario
    for scenario in (
        Scenario(
            "isolation",
            "what the isolator does at one orientation: passive, then active",
            "ps_fmu.scenarios.isolation",
            duration_s=20.0,
            alone=True,
            compares=True,
            storage_step_s=1e-3,
        ),
        Scenario(
            "pointing",
            "a slew to an inertial direction with the line-of-sight loop, off, then on",
            "ps_fmu.scenarios.pointing",
            duration_s=90.0,
            system="LineOfSight.ssd",
            alone=True,
        ),
        Scenario(
            "slew",
            "a slew without disturbance, the isolator off, then on",
            "ps_fmu.scenarios.slew",
            duration_s=100.0,  # the profile, then at least 60 s to settle
            alone=True,
        ),
        Scenario(
            "wheels",
            "reaction wheels run up, passive then active: waterfall and worst crossing",
            "ps_fmu.scenarios.wheels",
            duration_s=120.0,
            alone=True,
        ),
        Scenario(
            "trajectories",
            "Fig 7 of the paper: closed paths and a random walk, each with three solvers",
            "ps_fmu.paper.figures.fig07.report",
            duration_s=60.0,  # up to 25 targets of a path
            step_s=1e-3,
        ),
        Scenario(
            "stability",
            "Fig 10 of the paper: what follows a pulse on the bus, with delay in the loop",
            "ps_fmu.paper.figures.fig10.report",
            duration_s=10.0,  # after the pulse, for each case
        ),
        Scenario(
            "table2",
            "Table 2 of the paper: four orientations, passive and active",
            "ps_fmu.paper.figures.table2.report",
            duration_s=100.0,  # window of the statistics, at each orientation
        ),
    )
}
"""All scenarios by name: those of the product, then those of the paper's figures."""
PLAIN = Scenario(
    "plain",
    "any system, run once",
    "ps_fmu.runs.plain",
    duration_s=math.nan,
    step_s=math.nan,
    storage_step_s=0.0,  # each step
    system="",
    cases=("run",),
    alone=True,
    seed=None,
    foreign=True,
)
"""What runs a system that is named itself, in place of a scenario."""


def find_scenario(name: str) -> Scenario | None:
    """The scenario of this name, or :data:`PLAIN`; None if there is none."""
    return PLAIN if name == PLAIN.name else SCENARIOS.get(name)
