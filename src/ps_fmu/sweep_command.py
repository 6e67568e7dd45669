"""``ps-fmu sweep STUDY.toml``: a study of many cases, on this machine or on a cluster; or one of its cases again.

Exit codes: 0 all cases have a row, 1 the study cannot go on, 2 study or argument cannot be used, 130 interrupted by
Ctrl-C or SIGTERM.  Rows so far are kept in any case.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from .product.files import find_file
from .system_commands import add_system_options
from .terminal import read_output, reason

if TYPE_CHECKING:
    from .studies.sweep import SweepOptions

EXIT_FAILED, EXIT_REFUSED, EXIT_INTERRUPTED = 1, 2, 130


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of ``sweep``."""
    parser.description = (
        "Run the cases of a study, each with other parameters. The results are percentiles, the probability of meeting "
        "each requirement, worst cases and sensitivities.  docs/studies.md explains STUDY.toml and how to use more "
        "than one machine.  Needs the extra: pip install 'ps-fmu[sweep]'."
    )
    parser.add_argument("study", type=Path, metavar="STUDY.toml")
    parser.add_argument("--output", type=read_output, metavar="DIR", help="folder of the results (results/STUDY)")
    parser.add_argument("--resume", action="store_true", help="run the cases that have no result in DIR")
    parser.add_argument("--case", type=int, metavar="N", help="run case N alone, with all signals and a report")
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--scheduler", metavar="ADDRESS", help="address of a dask scheduler, such as tcp://node1:8786")
    parser.add_argument(
        "--scheduler-timeout", type=float, metavar="S", help="seconds that the scheduler may take to answer (10)"
    )
    where.add_argument("--workers", type=int, metavar="N", help="processes on this machine (one per processor)")
    add_system_options(parser, "replace", "fmus")
    parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the study, or one case of it; returns the exit code."""
    from .cosim.errors import CosimError
    from .mechanism.quantities import ParameterError
    from .requirements.requirement import RequirementError
    from .runs.options import OptionError, read_replacements
    from .slavekit.pack.build import BuildError
    from .studies.rows import StartError, VersionError
    from .studies.study import StudyError
    from .studies.sweep import SweepOptions

    study = find_file(arguments.study)
    try:
        options = SweepOptions(
            study,
            arguments.output or Path("results", arguments.study.stem),
            scheduler=arguments.scheduler,
            workers=arguments.workers,
            resume=arguments.resume,
            fmus=arguments.fmus,
            replace=read_replacements(arguments.replace),
            scheduler_timeout_s=arguments.scheduler_timeout,
        )
        if arguments.workers is not None and arguments.workers < 1:
            raise StudyError(f"--workers: expected 1 or more, got {arguments.workers}")
        if (limit := arguments.scheduler_timeout) is not None:
            if not 0.0 < limit < math.inf:
                raise StudyError(f"--scheduler-timeout: expected a time above 0 s, got {limit:g}")
            if arguments.scheduler is None:
                raise StudyError("--scheduler-timeout: only a study with --scheduler ADDRESS takes it")
        if arguments.case is not None:
            given = {"--resume": arguments.resume, "--workers": arguments.workers, "--scheduler": arguments.scheduler}
            for name in (name for name, value in given.items() if value):
                raise StudyError(f"{name}: --case runs one case, in this process: leave {name} out")
        return _rerun(options, arguments.case) if arguments.case is not None else _sweep(options)
    except (StudyError, OptionError, RequirementError, ParameterError) as error:
        return _report(reason(error), EXIT_REFUSED)
    except (BuildError, CosimError, StartError, VersionError, OSError) as error:
        return _report(reason(error), EXIT_FAILED)


def _sweep(options: SweepOptions) -> int:
    from .studies.bundle import open_folder
    from .studies.conclusion import conclude
    from .studies.rows import ClusterError, StartError, TrialError, VersionError
    from .studies.sweep import compute, hold, prepare

    prepared = prepare(options)
    with hold(options.output) as folder:
        open_folder(folder, prepared.plan, prepared.identity, resume=options.resume)
        try:
            compute(options, prepared, folder)
            print(conclude(options, prepared, folder))
        except KeyboardInterrupt:
            return _report(f"interrupted; rows so far are kept, go on with\n  {options.command}", EXIT_INTERRUPTED)
        except (ClusterError, StartError, TrialError, VersionError, OSError) as error:
            text = f"{reason(error)}\nRows so far are kept; go on with\n  {options.command}"
            return _report(text, EXIT_FAILED)
    return 0


def _rerun(options: SweepOptions, case: int) -> int:
    from .studies.sweep import rerun

    print(rerun(options, case))
    return 0


def _report(text: str, code: int) -> int:
    print(f"ps-fmu sweep: {text}", file=sys.stderr)
    return code
