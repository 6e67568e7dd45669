"""Every number of the paper beside ours in one table, and the errata with their evidence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict
from importlib import import_module
from typing import TYPE_CHECKING

from . import published
from .command import MODULES, Options
from .figures.table2.analysis import knowledge_text
from .result import Analysis, Finding

if TYPE_CHECKING:
    from .errata import Erratum

#: The analyses whose findings and figures are put together: modules of this package, in the order they run.
PARTS = ("workspace", "trajectories", "transmissibility", "stability", "jitter")


def analyse(options: Options) -> Analysis:
    """Run the other analyses, compute the errata, put everything together."""
    from tqdm import tqdm

    from . import settings
    from .errata import ENTRIES, errata_table

    found = settings.findings(options)  # first: without its files the rest is not worth the wait
    parts: list[Analysis] = []
    for name in tqdm(PARTS, desc="analyses", disable=not options.progress):
        parts.append(import_module(f".{MODULES[name]}", __package__).analyse(options))
        parts[-1].write(options.output)
        found += parts[-1].findings
    errata = [entry() for entry in tqdm(ENTRIES, desc="errata", disable=not options.progress)]
    findings = in_order_of_the_paper(found)
    missing = not_computed(findings)
    return Analysis(
        name="paper",
        title="The paper's numbers, and ours",
        text=paragraphs(findings, parts, errata),
        findings=findings,
        tables=[errata_table(errata)],
        pictures=[picture for part in parts for picture in part.pictures],
        data={"not_computed": missing, "errata": [asdict(erratum) for erratum in errata]},
    )


def paragraphs(findings: Sequence[Finding], parts: Iterable[Analysis], errata: Sequence[Erratum]) -> list[str]:
    """What is in the tables, and where there is more."""
    numeric = sum(erratum.error_printed is not None for erratum in errata)
    return [
        counted(findings),
        knowledge_text(),
        *(f"{part.title}: more in {part.name}.md." for part in parts),
        f"The errata have {len(errata)} entries. For {numeric} of them the error of the printed form is a number; "
        "all of these are computed anew with this report.",
    ]


def in_order_of_the_paper(found: Iterable[Finding]) -> list[Finding]:
    """One finding for each published number, those that were not found among them.

    Where one analysis computes a number and another co-simulates it, both are joined.

    Raises
    ------
    ValueError: two values of the same kind for one number.
    """
    by_key: dict[str, Finding] = {}
    for finding in found:
        known = by_key.get(finding.key)
        by_key[finding.key] = known.joined(finding) if known else finding
    return [by_key.get(key, Finding(key)) for key in published()]


def counted(findings: Sequence[Finding]) -> str:
    """How many numbers the table has, and which of ours stand beside them, as a paragraph."""
    missing = not_computed(findings)
    settings = sum(finding.setting for finding in findings)
    both = sum(None not in (finding.computed, finding.cosimulated) for finding in findings)
    return (
        f"The table has {len(findings)} numbers of the paper: those of its Tables 1 and 2, and what its text says of "
        f"its figures, methods and results. {settings} of them are settings, which equations and FMUs have as input. "
        + (f"{len(missing)} of" if missing else "All")
        + f" the other {len(findings) - settings} are {'not ' if missing else ''}computed here; for {both} there is a "
        "value from the equations and one from the running FMUs, and the column of differences has both."
    )


def not_computed(findings: Iterable[Finding]) -> list[str]:
    """Keys of the numbers that have neither a computed nor a co-simulated value."""
    return [finding.key for finding in findings if not finding.found]
