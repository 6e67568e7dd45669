"""Every number of the paper beside ours in one table, and the errata with their evidence."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict

from ..analyses.result import AnalysisResult, Finding
from ..analyses.table import ANALYSES, AnalysisOptions
from ..control.commander import DEFAULT_ALGORITHM_1
from ..cosim.ssp.parameters import read_parameters
from ..mechanism.parameters import load
from ..theory.loop import loop_at
from . import errata
from .errata import Erratum, errata_table
from .figures.table2.runs import ORIENTATIONS, knowledge_text
from .published import ANGLES, make_finding, published_numbers
from .workspace import STEP

FIGURES = ("workspace", "trajectories", "transmissibility", "stability", "jitter")
"""The analyses that are put together."""


def analyse(options: AnalysisOptions) -> AnalysisResult:
    """Run the analyses of the figures, compute the errata, put everything together.

    Each analysis writes its files when it has ended.  Raises what the analyses raise, and OSError.
    """
    found = list_settings(options)  # first: a missing parameter file is noticed before the long runs
    parts = []
    for name in FIGURES:
        parts.append(ANALYSES[name].load()(options))
        parts[-1].write(options.output)
        found += parts[-1].findings
    entries, findings = errata.errata(), order_findings(found)
    return AnalysisResult(
        name="paper",
        title="The paper's numbers, published and computed",
        text=paragraphs(findings, entries),
        findings=findings,
        tables=[errata_table(entries)],
        pictures=[picture for part in parts for picture in part.pictures],
        parts=parts,
        data={"not_computed": find_missing(findings), "errata": [asdict(erratum) for erratum in entries]},
    )


def paragraphs(findings: Sequence[Finding], entries: Sequence[Erratum]) -> list[str]:
    """What the tables hold."""
    numeric = sum(erratum.error_printed is not None for erratum in entries)
    return [
        count_text(findings),
        knowledge_text(),
        f"The errata have {len(entries)} entries. For {numeric} of them the error of the printed form is a number; "
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
    return [by_key.get(key, make_finding(key)) for key in published_numbers()]


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


def list_settings(options: AnalysisOptions) -> list[Finding]:
    """A finding for each setting.

    Raises
    ------
    OSError: a parameter file of the system is missing.
    """
    folder = options.system.parent / "parameters"
    damping = read_parameters(folder / "large_damping.ssv")["plant.fine_leg_1.damping"]
    delay = read_parameters(folder / "delay_20ms.ssv")["isolator.delay"]
    p, lighter = load(bus="OSM"), load(bus="LSM")
    controller = loop_at(p).controller
    integrators = controller.n_states - 3 * controller.lowpass.order  # the high-pass is in them: those of six axes
    values = {
        "epsilon": DEFAULT_ALGORITHM_1.epsilon,
        "workspace_step": 1e3 * STEP,  # mm
        "OSM_mass": p.bus.mass,
        "LSM_mass": lighter.bus.mass,
        "payload_mass": p.payload.mass,
        "fine_damping": p.manipulator.fine_legs[0].damping,
        "fine_damping_large": float(damping),
        "delay": float(delay),
        "lowpass_order": float(controller.lowpass.order),
        "lowpass_stop": p.filters.lowpass_stop_frequency,
        "highpass_order": integrators / 6,
        "highpass_corner": p.filters.highpass_frequency,
        "noise_from": float(p.noise.band[0]),
        "noise_to": float(p.noise.band[1]),
        **{f"orientation_{angle}": ORIENTATIONS[angle][i] for i, angle in enumerate(ANGLES)},
    }
    return [make_finding(f"text.{name}", computed=value, setting=True) for name, value in values.items()]
