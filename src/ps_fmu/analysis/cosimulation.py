"""Runs of the co-simulated system for an analysis, with the FMUs as they are built in the checkout."""

from __future__ import annotations

from typing import TYPE_CHECKING

from .command import Options

if TYPE_CHECKING:
    from ..scenarios.options import RunOptions


def run_options(options: Options, scenario: str, duration_s: float, step_s: float) -> RunOptions:
    """Options of a scenario's runs; results go into a folder of its name beside those of the analysis.

    Builds the FMUs if they are missing or older than their sources.  Raises BuildError, OptionError.
    """
    from ..fmu.build import default_fmus
    from ..scenarios.options import RunOptions
    from ..scenarios.sources import ensure_built

    ensure_built(options.fmus, default_fmus().parent)
    return RunOptions(
        scenario,
        options.system,
        options.output / scenario,
        duration_s,
        step_s,
        options.seed,
        fmus=options.fmus,
        progress=options.progress,
    ).claim_output()
