"""``ps-fmu run SYSTEM.ssp|.ssd|.xml|FMU``: any system of FMI 2.0 co-simulation FMUs, of whatever maker.

``ps-fmu run SCENARIO``, which is about the pointing manipulator, is :mod:`.run_command`.  Exit codes are the same: 0
done, 1 the run failed, 2 an argument cannot be used, 130 interrupted by Ctrl-C or SIGTERM (results so far are kept).
"""

from __future__ import annotations

import argparse
import math
import shlex
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from .cosim.checkpoint import add_checkpoint_options
from .cosim.errors import CosimError, MissingFmuError, UsageError
from .cosim.isolation.instance import add_isolation_options, read_isolation
from .cosim.schemes.scheme import add_scheme_options, read_scheme
from .cosim.ssp.osp import OSP_NAME
from .cosim.ssp.sources import SSD_NAME
from .product.files import find_file
from .runs.any_system import run_any
from .runs.built_fmus import find_built_folder, is_own, provide_fmus
from .runs.faults_option import add_faults_option, find_faults
from .runs.options import PLOT, RESULTS, AnyRun, OptionError, claim_folder
from .runs.output import hold_folder, leave_no_empty_folder, report_end
from .runs.scenario import SCENARIOS
from .slavekit.pack.errors import BuildError
from .terminal import read_output, reason

SUFFIXES = (".ssp", ".ssd", ".fmu", ".xml")
ABOUT = (
    "Run a system of FMUs: an SSP archive, a system structure description, libcosim's OspSystemStructure.xml, or a "
    "single FMU (FMI 2.0, co-simulation).  This loads the libraries of the FMUs and runs their code, which can do all "
    "that you can."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of a run of any system to a parser."""
    parser.description = ABOUT
    parser.usage = "%(prog)s SYSTEM.ssp|.ssd|.xml|FMU [options]   (--help lists them)"  # an error shows it
    parser.epilog = (
        "What is not given is taken from the default experiment of the system, or else of its FMUs.  "
        "docs/run-any-system.md has the features of SSP and the form of the files."
    )
    add = parser.add_argument
    add("system", type=Path, metavar="SYSTEM.ssp|.ssd|.xml|FMU")
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
    add("--output", type=read_output, metavar="DIR", help="folder of the results (results/SYSTEM)")
    add(
        "--fmus", type=Path, metavar="DIR",
        help="folder with the FMUs of an .ssd, found by their file names; those of ps_fmu's own systems are found and "
        "built without it",
    )  # fmt: skip
    add("--outside", action="store_true", help="let the system use files outside of its folder or archive")
    add("--profile", action="store_true", help="say where the time goes, and when the longest step was")
    add_isolation_options(parser)
    add_scheme_options(parser)
    add_checkpoint_options(parser)
    add("--no-figures", dest="figures", action="store_false", help="draw no plot")


_FLAGS = ("--error-estimate", "--isolate", "--no-figures", "--outside", "--profile")
"""Options of both commands without a value."""


def is_meant(arguments: Sequence[str]) -> bool:
    """Whether the arguments of ``ps-fmu run`` name a system and not a scenario: values of options may look like one.

    A first argument that is a file, or a path with a slash, is meant as a system, too, though it cannot be run.  The
    name of a scenario is that, whatever lies in the working directory: a file of that name is ``./slew``.
    """
    first = Path(arguments[0] if arguments else "")
    if not str(first).startswith("-") and (first.is_file() or _is_system_folder(first) or len(first.parts) > 1):
        if len(first.parts) == 1 and arguments:
            return arguments[0] not in SCENARIOS
        return bool(arguments)
    for before, argument in zip(("", *arguments), arguments, strict=False):
        is_value = before.startswith("-") and "=" not in before and not any(flag.startswith(before) for flag in _FLAGS)
        if not is_value and not argument.startswith("-") and Path(argument).suffix.lower() in SUFFIXES:
            return True
    return False


def _is_system_folder(folder: Path) -> bool:
    return any((folder / name).is_file() for name in (SSD_NAME, OSP_NAME))


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
            if is_own(options.system) and options.fmus is None:
                options = replace(options, fmus=find_built_folder())
                provide_fmus(find_built_folder(), options.system)
            run_any(options)
        except KeyboardInterrupt:
            return report_end(program, "interrupted", options.output, 130)
        except (BuildError, CosimError, OSError) as error:
            return report_end(program, reason(error) + _suggest_folder(options, error), options.output, 1, error)
    print(f"results in {options.output}: {RESULTS}{f', {PLOT}' if (options.output / PLOT).is_file() else ''}")
    return 0


def _suggest_folder(options: AnyRun, error: Exception) -> str:
    """What to type for an FMU that is not where the system says; nothing for other errors."""
    if not isinstance(error, MissingFmuError) or options.system.suffix.lower() not in (".ssd", ".xml"):
        return ""
    command = shlex.join(["ps-fmu", "run", str(options.system), "--fmus"])
    folder = find_built_folder()
    if options.fmus is None and (folder / error.fmu.name).is_file():
        return f"\nThere is one in {folder}: {command} {shlex.quote(str(folder))}"
    return f"\n{command} DIR takes FMUs by their file names from a folder"


def read_options(arguments: argparse.Namespace) -> AnyRun:
    """Checked options.  Raises OptionError."""
    system: Path = find_file(arguments.system)
    parameters = tuple(map(find_file, arguments.parameters))
    files = [("--parameters", path) for path in parameters]
    files += [("--input", arguments.input)] if arguments.input is not None else []
    faults = find_faults(arguments.faults)
    files += [("--faults", faults)] if faults is not None else []
    for name, path in [("SYSTEM", system), *files]:
        if not path.exists():
            raise OptionError(f"{name}: there is no file {path}")
    if not (system.suffix.lower() in SUFFIXES or _is_system_folder(system)):
        what = f"a folder without {SSD_NAME} and {OSP_NAME}" if system.is_dir() else "another file"
        known = "an archive (.ssp), a system description (.ssd, or libcosim's .xml) or an FMU (.fmu)"
        raise OptionError(f"SYSTEM: expected {known}; {system} is {what}")
    if arguments.fmus is not None and not arguments.fmus.is_dir():
        raise OptionError(f"--fmus: there is no folder {arguments.fmus}")
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
        parameters=parameters,
        inputs=arguments.input,
        observe=tuple(arguments.observe),
        scheme=scheme,
        outside=arguments.outside,
        fmus=arguments.fmus,
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
