"""Write the results of a scenario: summary.json, report.html, and the last line on the terminal."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ..requirements.verdict import Answer, format_verdicts, list_remarks, summarise
from ..requirements.verdict import Verdict as Judgement
from ..results.page.content import Exploration, Verdict
from ..results.report import Picture, Report
from ..results.summary import RunSummary, versions
from ..results.tables import Table
from .cases import Outcome
from .fault_report import list_faults, tabulate_faults
from .finish import finish_file
from .options import REPORT, RESULTS, SUMMARY, RunOptions
from .setup import SEED, RunSystem, collect_parameters, identify_fmus


class NotMetError(ValueError):
    """Requirements are not met, or it cannot be said."""


@dataclass(frozen=True)
class Findings:
    """The results of a scenario.  The three lists are those of :class:`RunSummary`; ``more`` goes there, too."""

    title: str
    text: Sequence[str]  # paragraphs of the report
    tables: Sequence[Table]
    pictures: Sequence[Picture]
    outcomes: Sequence[Outcome]
    orientation_deg: Sequence[float]  # roll, pitch, yaw
    rms_passive_rad: Sequence[float] | None
    rms_active_rad: Sequence[float] | None
    rejection_percent: Sequence[float] | None
    more: Mapping[str, object] = field(default_factory=dict)
    verdicts: Sequence[Verdict] = ()  # on the scenario's own requirements; one that cannot be said is no failure
    explored: Exploration = Exploration()  # charts and motion of the report

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds of all runs per second."""
        return sum(o.simulated_s for o in self.outcomes) / sum(o.wall_s for o in self.outcomes)


def publish(options: RunOptions, system: RunSystem, findings: Findings) -> None:
    """Write summary.json and report.html; say on the terminal what was required, how fast it went and where they are.

    Raises ``OSError`` if they cannot be written, and after that :class:`NotMetError` for requirements that are not met,
    of the user or of the scenario.
    """
    try:
        finish_file(options.output / RESULTS, system.indices, system.results)
    except OSError as error:  # the rows are there; nothing else is to be lost
        system.warnings.add(str(error))
    finally:
        system.results.close()
    verdicts = system.judge.conclude()
    remarks = list_remarks(verdicts)
    required = {"verdicts": [verdict.as_dict() for verdict in verdicts]} if verdicts else {}
    fmus = identify_fmus(system)
    parameters = collect_parameters(options, system)
    acted = {outcome.case.name: outcome.faults for outcome in findings.outcomes}
    faults = [] if options.faults is None else [tabulate_faults(acted)]
    RunSummary(
        scenario=options.scenario.name,
        orientation_deg=findings.orientation_deg,
        step_s=options.step_s,
        duration_s=options.duration_s,
        seed=int(system.get_start(SEED)),
        rms_passive_rad=findings.rms_passive_rad,
        rms_active_rad=findings.rms_active_rad,
        rejection_percent=findings.rejection_percent,
        real_time_factor=findings.real_time_factor,
        fmus=fmus,
        more={
            **findings.more,
            **required,
            **({} if options.faults is None else {"faults": list_faults(options.faults, acted)}),
            **({"costs": system.costs.as_dict()} if options.profile else {}),
            "indices": system.indices.as_dict(),
            "parameters": parameters,
            "warnings": system.warnings.texts,
        },
    ).write(options.output / SUMMARY)
    Report(
        title=findings.title,
        verdicts=[*map(show_verdict, verdicts), *findings.verdicts],
        text=[*remarks, *findings.text],
        tables=[*faults, *findings.tables],
        explored=findings.explored,
        pictures=findings.pictures,
        parameters=parameters,
        fmus=fmus,
        versions=versions(),
        warnings=system.warnings.texts,
    ).write(options.output / REPORT)
    if verdicts:
        print(format_verdicts(verdicts))
    for table in (*faults, *system.costs.to_tables()):
        print(f"{table.caption}\n{table.to_text()}\n")
    print(f"{findings.real_time_factor:.1f} x real time; results in {options.output}")
    missed = [] if all(verdict.met for verdict in verdicts) else [f"requirements: {summarise(verdicts)}"]
    if own := [verdict for verdict in findings.verdicts if verdict.met is False]:
        count = f"{len(own)} of {len(findings.verdicts)}"
        missed.append(f"{count} requirements of the scenario are not met: {own[0].requirement}")
    if missed:
        raise NotMetError("; ".join(missed))


def show_verdict(found: Judgement) -> Verdict:
    """A verdict as a row of the report."""
    name, _, signal, case, value, bound, limit, margin = found.as_row()
    sure = found.requirement.confidence
    return Verdict(
        requirement=f"{name}: {found.requirement.about}, {signal}, {case}",
        value=value,
        limit=limit,
        margin=margin,
        confidence="-" if sure is None else f"below {bound} with {100.0 * sure:g} %" if bound != "-" else "no bound",
        met=None if found.answer is Answer.OPEN else found.met,
    )
