"""Run a scenario and publish what it finds: the one way from options to results in a folder."""

from __future__ import annotations

from collections.abc import Callable

from ..cosim.structure import suggest_names
from .options import OptionError, RunOptions
from .publish import Findings, NotMetError, TargetError, list_missed, publish
from .run import Run


def find(run: Run) -> Findings:
    """Run the cases of the scenario; what comes of them.  Nothing is printed or drawn.

    Raises :class:`.options.OptionError` for a case that the scenario has not.
    """
    scenario = run.options.scenario
    if run.only and not scenario.alone:
        raise OptionError(f"cases: the scenario {scenario.name} needs all of its cases")
    for name in run.only:
        if name not in (known := scenario.find_cases()):
            raise OptionError(f"cases: there is no {name!r}{suggest_names(name, known)}; there are {', '.join(known)}")
    found: Findings = scenario.load().find(run)
    return found


def run_scenario(options: RunOptions, show: Callable[[str], None] = print) -> None:
    """Run the scenario of the options; writes results.nc, summary.json, figures and report.html, shows the tables.

    Raises after that :class:`.publish.TargetError` if a target is out of reach, and :class:`.publish.NotMetError` for
    requirements that are not met.
    """
    run = Run(options)
    findings = find(run)
    show(findings.printed)
    show(publish(options, run.system, findings))
    if missed := list_missed(run.system, findings):
        raise NotMetError("; ".join(missed))
    if findings.refused:
        raise TargetError(findings.refused)
