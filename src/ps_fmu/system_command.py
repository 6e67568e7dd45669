"""``ps-fmu run SYSTEM.ssp|.ssd|FMU``: any system of FMI 2.0 co-simulation FMUs, of whatever maker.

``ps-fmu run SCENARIO``, which is about the pointing manipulator, is :mod:`.run_command`.  Exit codes are the same: 0
done, 1 the run failed, 2 an argument cannot be used, 130 interrupted by Ctrl-C or SIGTERM (results so far are kept).
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from pathlib import Path

from .cosim.checkpoint.options import add_checkpoint_options
from .cosim.errors import CosimError, UsageError
from .cosim.isolation.options import add_isolation_options, read_isolation
from .cosim.schemes.options import add_scheme_options, read_scheme
from .cosim.ssp.sources import SSD_NAME
from .runs.any_system import run_any
from .runs.faults_option import add_faults_option, find_faults
from .runs.options import PLOT, RESULTS, AnyRun, OptionError, claim_folder
from .runs.output import hold_folder, leave_no_empty_folder, report_end
from .terminal import reason

SUFFIXES = (".ssp", ".ssd", ".fmu")
ABOUT = (
    "Run a system of FMUs: an SSP archive, a system structure description, or a single FMU (FMI 2.0, co-simulation).  "
    "This loads the libraries of the FMUs and runs their code, which can do all that you can."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a run of any system to a parser."""
    parser.description = ABOUT
    parser.usage = "%(prog)s SYSTEM.ssp|.ssd|FMU [options]   (--help lists them)"  # an error shows it
    parser.epilog = (
        "What is not given is taken from the default experiment of the system, or else of its FMUs.  "
        "docs/run-any-system.md has the features of SSP and the form of the files."
    )
    add = parser.add_argument
    add("system", type=Path, metavar="SYSTEM.ssp|.ssd|FMU")
    add("--duration", type=_read_time, metavar="S", help="seconds to simulate")
    add("--step", type=_read_time, metavar="S", help="communication step in seconds")
    add("--storage-step", type=_read_time, metavar="S", help="seconds between stored rows (each step)")
    add(
        "--parameters", type=Path, nargs="+", action="extend", default=[], metavar="F.ssv",
        help="files with other start values, by component.variable; later ones win",
    )  # fmt: skip
    add("--input", type=Path, metavar="F.csv", help="inputs over time: a head time,name,... and rows in seconds")
    add_faults_option(parser)
    add(
        "--observe", action="append", default=[], metavar="PATTERN",
        help="variables to store and draw, such as 'plant.*'; may be repeated (all outputs)",
    )  # fmt: skip
    add("--output", type=Path, metavar="DIR", help="folder of the results (results/SYSTEM)")
    add("--outside", action="store_true", help="let the system use files outside of its folder or archive")
    add("--profile", action="store_true", help="say where the time goes, and when the longest step was")
    add_isolation_options(parser)
    add_scheme_options(parser)
    add_checkpoint_options(parser)
    add("--no-figures", dest="figures", action="store_false", help="draw no plot")


def is_meant(arguments: Sequence[str]) -> bool:
    """Whether the arguments of ``ps-fmu run`` name a system and not a scenario, which ``--system`` could have.

    A first argument that is a file, or a path with a slash, is meant as a system, too, though it cannot be run.
    """
    first = Path(arguments[0] if arguments else "")
    if not str(first).startswith("-") and (first.is_file() or (first / SSD_NAME).is_file() or len(first.parts) > 1):
        return bool(arguments)
    for before, argument in zip(("", *arguments), arguments, strict=False):
        if Path(argument).suffix.lower() in SUFFIXES and before not in ("--system", "--ssp"):
            return not argument.startswith("-")
    return False


def run(arguments: argparse.Namespace, command_line: argparse.ArgumentParser) -> int:
    """Run the system of parsed arguments; returns the exit code.  ``command_line``: the parser, for its errors."""
    program = command_line.prog
    try:
        return run_system(read_options(arguments), program)
    except OptionError as error:
        command_line.error(str(error))


def run_system(options: AnyRun, program: str) -> int:
    """Run the system of checked options; returns the exit code.

    Raises OptionError for an option that cannot be honoured, as the system shows.
    """
    with leave_no_empty_folder(options.output), hold_folder(claim_folder(options.output), options.resume):
        try:
            run_any(options)
        except KeyboardInterrupt:
            return report_end(program, "interrupted", options.output, 130)
        except (CosimError, OSError) as error:
            return report_end(program, reason(error), options.output, 1)
    print(f"results in {options.output}: {RESULTS}{f', {PLOT}' if (options.output / PLOT).is_file() else ''}")
    return 0


def read_options(arguments: argparse.Namespace) -> AnyRun:
    """Checked options.  Raises OptionError."""
    system: Path = arguments.system
    files = [("--parameters", path) for path in arguments.parameters]
    files += [("--input", arguments.input)] if arguments.input is not None else []
    faults = find_faults(arguments.faults)
    files += [("--faults", faults)] if faults is not None else []
    for name, path in [("SYSTEM", system), *files]:
        if not path.exists():
            raise OptionError(f"{name}: there is no file {path}")
    if not (system.suffix.lower() in SUFFIXES or Path(system, SSD_NAME).is_file()):
        what = f"a folder without {SSD_NAME}" if system.is_dir() else "another file"
        known = "an archive (.ssp), a system description (.ssd) or an FMU (.fmu)"
        raise OptionError(f"SYSTEM: expected {known}; {system} is {what}")
    try:
        isolation, scheme = read_isolation(arguments), read_scheme(arguments)
    except UsageError as error:
        raise OptionError(str(error)) from error
    output = (arguments.output or Path("results", system.stem)).absolute()
    return AnyRun(
        system=system,
        output=output,
        duration_s=arguments.duration,
        step_s=arguments.step,
        storage_step_s=arguments.storage_step,
        parameters=tuple(arguments.parameters),
        inputs=arguments.input,
        observe=tuple(arguments.observe),
        scheme=scheme,
        outside=arguments.outside,
        figures=arguments.figures,
        profile=arguments.profile,
        isolation=isolation,
        faults=faults,
        checkpoint_s=arguments.checkpoint,
        source=arguments.source,
        anew=tuple(arguments.anew),
    )


def _read_time(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"expected a time above 0 s, got {text!r}")
    return value
