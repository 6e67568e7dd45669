"""Runs of the co-simulated system for an analysis, with the FMUs as they are built in the checkout."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..runs.options import RunOptions, Scenario
    from .command import Options


def check_sources(system: Path) -> None:
    """Refuse, before anything is made, what cannot be co-simulated.

    Raises
    ------
    OptionError: there is no system description ``system``; says where one is.
    BuildError: the FMUs' sources are not there: the package does not run from a checkout.
    """
    from ..runs.options import OptionError
    from ..slavekit.pack.build import BuildError, default_fmus

    try:
        checkout = default_fmus().parent
    except BuildError as error:
        raise BuildError(
            "the FMUs' sources are not there: this analysis needs ps_fmu to be installed from a checkout with pip's -e"
        ) from error
    if not system.exists():
        raise OptionError(
            f"--system: there is no system description {system}: work in {checkout}, or give "
            f"--system {checkout / 'system' / 'SystemStructure.ssd'}"
        )


def run_options(options: Options, scenario: Scenario, duration_s: float, step_s: float) -> RunOptions:
    """Options of a scenario's runs; results go into a folder of its name beside those of the analysis.

    Makes that folder, then builds the FMUs if they are missing or older than their sources.  Raises BuildError,
    OptionError.
    """
    from ..runs.options import RunOptions
    from ..runs.sources import ensure_built
    from ..slavekit.pack.build import default_fmus

    run = RunOptions(
        scenario,
        options.system,
        options.output / scenario.name,
        duration_s,
        step_s,
        options.seed,
        fmus=options.fmus,
        progress=options.progress,
    ).claim_output()
    ensure_built(options.fmus, default_fmus().parent)
    return run
