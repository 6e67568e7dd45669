"""Run a scenario and publish what it finds: the one way from options to results in a folder."""

from __future__ import annotations

from collections.abc import Callable

from ..cosim.structure import suggest_names
from ..results.style import prepare_drawing
from .built_fmus import find_built_folder, provide_fmus
from .kept_run import keep_run
from .options import OptionError, RunOptions
from .publish import Done, Findings, publish
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


def build_fmus(options: RunOptions) -> None:
    """Build the FMUs of ps_fmu, where the options name their folder and they are missing or older than their sources.

    Raises BuildError, CosimError, OSError.
    """
    if options.fmus is not None and options.fmus == find_built_folder():
        provide_fmus(options.fmus, options.system)


def execute(options: RunOptions, show: Callable[[str], None] = print) -> Done:
    """Run the scenario of the options; writes results.nc, summary.json, figures and report.html, shows the tables.

    The output folder is held by :func:`.output.hold_folder`.

    Raises
    ------
    OptionError: an option cannot be honoured, as the system shows.
    BuildError, CosimError, OSError, ValueError: the FMUs cannot be built or run, or results cannot be written.
    """
    build_fmus(options)
    if options.figures:
        prepare_drawing()
    with keep_run(options):
        run = Run(options)
        findings = find(run)
        show(findings.printed)
        return publish(run.options, run.system, findings, show)
