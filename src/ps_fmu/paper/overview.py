"""Every number of the paper beside ours in one table, and the errata with their evidence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict

from tqdm import tqdm

from . import errata, published_settings
from .analysis import AnalysisOptions, find_figure_analyses
from .analysis_result import AnalysisResult
from .errata import Erratum, errata_table
from .figures.table2.closed_form import knowledge_text
from .finding import Finding
from .published import published_numbers


def analyse(options: AnalysisOptions) -> AnalysisResult:
    """Run the analyses of the figures, compute the errata, put everything together."""
    findings = published_settings.findings(options)  # first: a missing parameter file is noticed before the long runs
    parts: list[AnalysisResult] = []
    for analysis in tqdm(find_figure_analyses().values(), desc="analyses", disable=not options.progress):
        parts.append(analysis.analyse(options))
        parts[-1].write(options.output)
        findings += parts[-1].findings
    entries = [entry() for entry in tqdm(errata.ENTRIES, desc="errata", disable=not options.progress)]
    findings = order_findings(findings)
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
