"""The results of a scenario, and their files: summary.json, figures, report.html, and what the terminal shows."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from ..cosim.faults.binding import ActedFault
from ..requirements.verdict import Answer, Verdict, format_verdicts, list_remarks, summarise
from ..results.figures import Painter, draw_exploration
from ..results.page.content import Exploration, VerdictRow
from ..results.report import Picture, Report
from ..results.summary import versions, write_summary
from ..results.tables import Table, format_tables
from .cases import Outcome
from .divergence import LoopState, judge_loops
from .options import REPORT, RESULTS, SUMMARY, RunOptions
from .stored_rows import finish_file
from .system import SEED, RunSystem, collect_parameters, has_disturbance

States = Mapping[str, LoopState]


@dataclass(frozen=True)
class Done:
    """A run whose results are all written."""

    missed: Sequence[str]  # requirements that are not shown to be met
    refused: str  # targets that are out of reach

    @property
    def failures(self) -> str:
        """Why the run is no success; empty if it is one."""
        return "; ".join(self.missed) or self.refused


@dataclass(frozen=True)
class Findings:
    """The results of a scenario.  The three lists, per axis of P, and ``more`` go into summary.json."""

    title: str
    outcomes: Sequence[Outcome]
    printed: str = ""  # what the terminal shows first
    orientation_deg: Sequence[float] | None = None  # roll, pitch, yaw
    text: Sequence[str] = ()  # paragraphs of the report
    tables: Sequence[Table] = ()
    tabulate: Callable[[], Sequence[Table]] = tuple  # tables of the report that take time to make
    rms_passive_rad: Sequence[float] | None = None
    rms_active_rad: Sequence[float] | None = None
    rejection_percent: Sequence[float] | None = None
    more: Mapping[str, object] = field(default_factory=dict)
    verdicts: Sequence[VerdictRow] = ()  # on the scenario's own requirements; one that cannot be said is no failure
    draw: Callable[[Path], Sequence[Picture]] = lambda _folder: ()  # draws what is no chart into a folder
    explore: Callable[[Path], Exploration] = lambda _path: Exploration()  # charts, their PNG files, motion
    refused: str = ""  # targets that are out of reach
    systems: Mapping[str, RunSystem] = field(default_factory=dict)  # of cases that did not run on that of the run

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds of all runs per second."""
        return sum(o.simulated_s for o in self.outcomes) / sum(o.wall_s for o in self.outcomes)


def publish(
    options: RunOptions,
    system: RunSystem,
    findings: Findings,
    show: Callable[[str], None],
    painter: Painter | None = None,
) -> Done:
    """Write figures, summary.json and report.html, and finish results.nc, all in the folder of the options.

    ``painter``: what draws the figures meanwhile; None: they are drawn here, if the options want any.  Shows verdicts,
    faults, costs, how fast it went and where the results are.  Raises ``OSError`` if they cannot be written.
    """
    explored = findings.explore(options.output / RESULTS)
    pictures: list[Picture] = []
    wait: Callable[[], Sequence[Picture]] = tuple
    if options.figures:
        draw_here = partial(draw_exploration, explored, options.output)
        wait = draw_here if painter is None else painter.begin(explored, options.output)
        pictures += findings.draw(options.output)
    try:
        finish_file(options.output / RESULTS, filled=all(outcome.ended is None for outcome in findings.outcomes))
    except OSError as error:  # the rows are there; nothing else is to be lost
        system.warnings.add(str(error))
    verdicts = system.judge.conclude()
    write_summary(options.output / SUMMARY, make_summary(options, system, findings))
    pictures = [*wait(), *pictures]
    faults = _tabulate_faults(options, findings)
    Report(
        title=findings.title,
        verdicts=[*map(show_verdict, verdicts), *findings.verdicts],
        text=[*list_remarks(verdicts), *list_states(options, system, findings), *findings.text],
        tables=[*faults, *findings.tables, *findings.tabulate()],
        explored=explored,
        pictures=pictures,
        parameters=collect_parameters(options, system),
        fmus=system.fmus,
        versions=versions(),
        warnings=system.warnings.texts,
    ).write(options.output / REPORT)
    speed = f"{findings.real_time_factor:.1f} x real time; results in {options.output}"
    show("\n".join([*describe(options, system, findings), speed]))
    return Done(list_missed(system, findings), findings.refused)


def describe(options: RunOptions, system: RunSystem, findings: Findings) -> list[str]:
    """What the terminal shows besides what was found: verdicts, faults and costs."""
    verdicts = system.judge.conclude()
    shown = [format_verdicts(verdicts)] if verdicts else []
    tables = *_tabulate_faults(options, findings), *system.costs.to_tables()
    return [*shown, format_tables(tables, list_states(options, system, findings))]


def make_summary(options: RunOptions, system: RunSystem, findings: Findings) -> dict[str, object]:
    """What summary.json says."""
    verdicts = system.judge.conclude()
    required = {"verdicts": [verdict.as_dict() for verdict in verdicts]} if verdicts else {}
    acted = {outcome.case.name: outcome.faults for outcome in findings.outcomes}
    return {
        "scenario": options.scenario.name,
        "orientation_deg": findings.orientation_deg,
        "step_s": options.step_s,
        "duration_s": options.duration_s,
        "seed": int(system.get_start(SEED)) if has_disturbance(system.descriptions) else None,
        "rms_passive_rad": findings.rms_passive_rad,
        "rms_active_rad": findings.rms_active_rad,
        "rejection_percent": findings.rejection_percent,
        "real_time_factor": findings.real_time_factor,
        "fmus": system.fmus,
        "versions": versions(),
        **findings.more,
        "stability": {case: state.as_dict() for case, state in find_states(options, system, findings).items()},
        **required,
        **({} if options.faults is None else {"faults": list_faults(options.faults, acted)}),
        **({"costs": system.costs.as_dict()} if options.profile else {}),
        "indices": system.indices.as_dict(),
        "parameters": collect_parameters(options, system),
        "warnings": system.warnings.texts,
    }


def find_states(options: RunOptions, system: RunSystem, findings: Findings, thorough: bool = False) -> States:
    """The stability of each case with a closed loop, by its name."""
    found: dict[str, LoopState] = {}
    for case in (outcome.case for outcome in findings.outcomes):
        own = findings.systems.get(case.name, system)
        found |= judge_loops(own, options, {case.name: case.values}, thorough)
    return found


def list_states(options: RunOptions, system: RunSystem, findings: Findings) -> list[str]:
    """A sentence for each state, with the cases that have it."""
    names: dict[str, list[str]] = {}
    for case, state in find_states(options, system, findings).items():
        names.setdefault(state.text, []).append(case)
    return [f"Stability, {', '.join(cases)}: {text}" for text, cases in names.items()]


def list_missed(system: RunSystem, findings: Findings) -> list[str]:
    """Requirements that are not met, of the user and of the scenario: a text for each group."""
    verdicts = system.judge.conclude()
    missed = [] if all(verdict.met for verdict in verdicts) else [f"requirements: {summarise(verdicts)}"]
    if own := [verdict for verdict in findings.verdicts if verdict.answer == Answer.NOT_MET.value]:
        count = f"{len(own)} of {len(findings.verdicts)}"
        missed.append(f"{count} requirements of the scenario are not met: {own[0].requirement}")
    return missed


def _tabulate_faults(options: RunOptions, findings: Findings) -> list[Table]:
    acted = {outcome.case.name: outcome.faults for outcome in findings.outcomes}
    return [] if options.faults is None else [tabulate_faults(acted)]


def show_verdict(found: Verdict) -> VerdictRow:
    """A verdict as a row of the report."""
    required, bound = found.requirement, found.bound
    sure, unit = required.confidence, required.limit.unit
    below = "no bound" if bound == "-" else f"below {bound} {unit} with {100.0 * (sure or 0.0):g} %"
    return VerdictRow(
        requirement=f"{required.name}: {required.about}, {found.signal}, {found.case}",
        value=found.value if found.value == "-" else f"{found.value} {unit}",
        limit=str(required.limit),
        margin=found.margin,
        confidence="-" if sure is None else below,
        answer=found.answer.value,
        remark=found.remark[:1].upper() + found.remark[1:],
    )


Acted = Mapping[str, Sequence[ActedFault]]
"""The faults that acted in each run, by its name."""


def list_faults(path: Path, acted: Acted) -> dict[str, object]:
    """The entry of summary.json."""
    return {"file": path.name, "acted": {run: [fault.as_dict() for fault in found] for run, found in acted.items()}}


def tabulate_faults(acted: Acted) -> Table:
    """Each fault, and the runs that it acted in."""
    runs: dict[str, list[str]] = {}
    for run, found in acted.items():
        for fault in found:
            runs.setdefault(fault.text, []).append(run)
    rows = [(text, ", ".join(names)) for text, names in runs.items()] or [("none has acted", ", ".join(acted))]
    return Table("Faults", ("fault", "run"), rows)
