"""Every number of the paper beside ours in one table, and the errata with their evidence."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace

from tqdm import tqdm

from ..runs.built_fmus import provide_fmus
from . import errata, published_settings
from .analysis import Analysis, AnalysisOptions, find_figure_analyses
from .analysis_result import AnalysisResult
from .errata import Erratum, errata_table
from .figures.table2.closed_form import knowledge_text
from .finding import Finding
from .jobs import Job, Report, run_jobs
from .published import published_numbers

ERRATA, ERRATA_COST_S = "errata", 6.0


def analyse(options: AnalysisOptions) -> AnalysisResult:
    """Run the analyses of the figures, compute the errata, put everything together.

    Each analysis writes its files when it has ended.  Raises :class:`.jobs.JobError` after all have ended if one of
    them has failed, and what comes before the first of them raises: BuildError, OSError, OptionError.
    """
    findings = published_settings.findings(options)  # first: a missing parameter file is noticed before the long runs
    analyses = find_figure_analyses()
    if any(analysis.needs_fmus for analysis in analyses.values()):
        provide_fmus(options.fmus, options.system)  # here: the processes of the jobs would all build them
    jobs = list_jobs(options, analyses)
    with show_progress(jobs, options.progress) as report:
        outcomes = run_jobs(jobs, report=report)
    outcomes.raise_failures()
    parts: list[AnalysisResult] = [outcomes.results[name] for name in analyses]
    entries: Sequence[Erratum] = outcomes.results[ERRATA]
    findings = order_findings([*findings, *(finding for part in parts for finding in part.findings)])
    return AnalysisResult(
        name="paper",
        title="The paper's numbers, and ours",
        text=paragraphs(findings, entries),
        findings=findings,
        tables=[errata_table(entries)],
        pictures=[picture for part in parts for picture in part.pictures],
        parts=parts,
        data={"not_computed": find_missing(findings), "errata": [asdict(erratum) for erratum in entries]},
    )


def list_jobs(options: AnalysisOptions, analyses: Mapping[str, Analysis]) -> list[Job]:
    """The jobs of the analyses, each analysis itself, and the errata."""
    options = replace(options, progress=False, threads=1)  # as many processes as processors are enough
    jobs = [Job(ERRATA, ERRATA_COST_S, errata.errata)]
    for name, analysis in analyses.items():
        before = analysis.jobs(options) if analysis.jobs else ()
        names = tuple(job.name for job in before)
        jobs += [*before, Job(name, analysis.cost_s, run_analysis, (analysis.name, options), names)]
    return jobs


def run_analysis(name: str, options: AnalysisOptions, found: Mapping[str, object] | None = None) -> AnalysisResult:
    """Run an analysis with what its jobs have ``found``, and write its files."""
    analysis = find_figure_analyses()[name]
    result = analysis.analyse(options, **({} if found is None else {"found": found}))
    result.write(options.output)
    return result


@contextmanager
def show_progress(jobs: Sequence[Job], shown: bool) -> Iterator[Report]:
    """A bar on the error stream with what runs and the time that remains."""
    total = sum(job.cost_s for job in jobs)
    form = "{desc}: {percentage:3.0f}% |{bar}| [{elapsed}<{remaining}{postfix}]"
    with tqdm(total=total, desc="analyses", disable=not shown, bar_format=form) as bar:

        def advance(cost_s: float, running: tuple[str, ...]) -> None:
            bar.set_postfix_str("; ".join(running), refresh=False)
            bar.update(cost_s)

        yield advance


def paragraphs(findings: Sequence[Finding], errata: Sequence[Erratum]) -> list[str]:
    """What the tables hold."""
    numeric = sum(erratum.error_printed is not None for erratum in errata)
    return [
        count_text(findings),
        knowledge_text(),
        f"The errata have {len(errata)} entries. For {numeric} of them the error of the printed form is a number; "
        "all of these are computed anew with this report.",
    ]


def order_findings(findings: Iterable[Finding]) -> list[Finding]:
    """One finding for each published number, in the order of the paper; without values where none was found.

    Where one analysis computes a number and another one measures it, both are joined.

    Raises
    ------
    ValueError: two values of the same kind for one number.
    """
    by_key: dict[str, Finding] = {}
    for finding in findings:
        known = by_key.get(finding.key)
        by_key[finding.key] = known.join(finding) if known else finding
    return [by_key.get(key, Finding(key)) for key in published_numbers()]


def count_text(findings: Sequence[Finding]) -> str:
    """A paragraph: how many numbers the table has, and how many of ours stand beside them."""
    missing = find_missing(findings)
    settings = sum(finding.setting for finding in findings)
    both = sum(None not in (finding.computed, finding.cosimulated) for finding in findings)
    return (
        f"The table has {len(findings)} numbers of the paper: those of its Tables 1 and 2, and what its text says of "
        f"its figures, methods and results. {settings} of them are settings: inputs of equations and FMUs. "
        + (f"{len(missing)} of" if missing else "All")
        + f" the other {len(findings) - settings} are {'not ' if missing else ''}computed here; for {both} there is a "
        "value from the equations and one from the running FMUs, and the column of differences has both."
    )


def find_missing(findings: Iterable[Finding]) -> list[str]:
    """Keys of the numbers that have neither a computed nor a co-simulated value."""
    return [finding.key for finding in findings if not finding.has_value]
