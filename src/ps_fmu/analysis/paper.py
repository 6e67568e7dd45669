"""Every number of the paper beside ours in one table, and the errata with their evidence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict
from importlib import import_module

from ..manipulator.parameters import load
from ..paper import published
from .command import Options
from .result import Analysis, Finding

#: The analyses whose findings and figures are put together: modules of this package, in the order they run.
PARTS = ("workspace", "trajectories", "transmissibility", "stability", "jitter")


def analyse(options: Options) -> Analysis:
    """Run the other analyses, compute the errata, put everything together."""
    from tqdm import tqdm

    from .errata import ENTRIES, errata_table

    found = parameter_findings(options)
    parts: list[Analysis] = []
    for name in tqdm(PARTS, desc="analyses", disable=not options.progress):
        parts.append(import_module(f".{name}", __package__).analyse(options))
        parts[-1].write(options.output)
        found += parts[-1].findings
    errata = [entry() for entry in tqdm(ENTRIES, desc="errata", disable=not options.progress)]
    findings = in_order_of_the_paper(found)
    missing = not_computed(findings)
    numeric = sum(erratum.error_printed is not None for erratum in errata)
    return Analysis(
        name="paper",
        title="The paper's numbers, and ours",
        text=[
            f"The paper gives {len(findings)} numbers. {len(findings) - len(missing)} of them are computed here"
            + (f"; the other {len(missing)} are marked in the table." if missing else "."),
            *(f"{part.title}: more in {part.name}.md." for part in parts),
            f"The errata have {len(errata)} entries. For {numeric} of them the error of the printed form is a number; "
            "all of these are computed anew with this report.",
        ],
        findings=findings,
        tables=[errata_table(errata)],
        pictures=[picture for part in parts for picture in part.pictures],
        data={"not_computed": missing, "errata": [asdict(erratum) for erratum in errata]},
    )


def parameter_findings(options: Options) -> list[Finding]:
    """The parameters that sections 4, 4.2 and 4.3 state, as the FMUs have them."""
    from ..cosim.parameters import read_parameters

    folder = options.system.parent / "parameters"
    original, lighter = load(bus="OSM"), load(bus="LSM")
    filters, fine_leg = original.filters, original.manipulator.fine_legs[0]
    return [
        Finding("text.OSM_mass", computed=original.bus.mass),
        Finding("text.LSM_mass", computed=lighter.bus.mass),
        Finding("text.payload_mass", computed=original.payload.mass),
        Finding("text.fine_damping", computed=fine_leg.damping),
        Finding(
            "text.fine_damping_large",
            computed=float(read_parameters(folder / "large_damping.ssv")["plant.fine_leg_1.damping"]),
        ),
        Finding("text.delay", computed=float(read_parameters(folder / "delay_20ms.ssv")["isolator.delay"])),
        Finding("text.lowpass_stop", computed=filters.lowpass_stop_frequency),
        Finding("text.highpass_corner", computed=filters.highpass_frequency),
    ]


def in_order_of_the_paper(found: Iterable[Finding]) -> list[Finding]:
    """One finding for each published number, those that were not found among them.

    Raises
    ------
    ValueError: two findings for one number.
    """
    by_key: dict[str, Finding] = {}
    for finding in found:
        if finding.key in by_key:
            raise ValueError(f"{finding.key}: two analyses find this number; which one belongs into the table?")
        by_key[finding.key] = finding
    return [by_key.get(key, Finding(key)) for key in published()]


def not_computed(findings: Iterable[Finding]) -> list[str]:
    """Keys of the numbers that have neither a computed nor a co-simulated value."""
    return [finding.key for finding in findings if not finding.found]
