"""``ps-fmu run SCENARIO|SYSTEM``, and the same as ``python system/run.py SCENARIO|SYSTEM`` in a checkout.

Exit codes: 0 done, 1 the run failed or a requirement is not met, 2 an argument cannot be used, 130 interrupted by
Ctrl-C or SIGTERM (results so far are kept).
"""

from __future__ import annotations

import argparse
import errno
import shlex
import sys
from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from .cosim.checkpoint import add_checkpoint_options
from .cosim.errors import CosimError, MissingFmuError, UsageError
from .cosim.isolation.instance import add_isolation_options
from .cosim.schemes.scheme import add_scheme_options, read_scheme
from .product.files import list_system_files
from .runs.keeping import read_run
from .runs.options import OptionError, RunOptions, claim_folder, make_options, name_option
from .runs.output import hold_folder, leave_no_empty_folder, report_end
from .runs.run import build_fmus, execute
from .runs.scenario import SCENARIOS
from .slavekit.pack.errors import BuildError
from .system_commands import add_system_options
from .terminal import read_output, reason

ABOUT = (
    "Run a scenario of the pointing manipulator, or any system of FMUs (FMI 2.0, co-simulation): an SSP archive, a "
    "system structure description, libcosim's OspSystemStructure.xml, a folder with one of these, or a single FMU.  "
    "The command loads the libraries of the FMUs and runs their code with your rights."
)
_NOT_GIVEN = (
    *("run", "what", "output", "resume", "isolate", "isolate_only"),
    *("scheme", "extrapolate", "rate", "solver", "tolerance", "error_estimate"),
)
"""Arguments that are read by functions of their own; the others are those of ``make_options``."""


def add_arguments(p: argparse.ArgumentParser) -> None:
    """Add the arguments of a run, and a list of the scenarios, to a parser."""
    listing = "\n".join(
        f"  {name:14}{scenario.about}\n{'':16}--duration {scenario.duration_s:g} --step {scenario.step_s:g} "
        f"--storage-step {scenario.storage_step_s:g}"
        for name, scenario in SCENARIOS.items()
    )
    p.formatter_class = argparse.RawDescriptionHelpFormatter
    p.description = ABOUT
    p.usage = "%(prog)s [SCENARIO | SYSTEM.ssp|.ssd|.xml | FMU.fmu] [options]   (--help lists them)"
    p.epilog = (
        f"scenarios and their defaults:\n{listing}\n\n"
        "any other system: times that you do not give are those of its default experiment, or of its FMUs; each step "
        "is stored.\n\nfiles of ps_fmu that you can give by name:\n"
        + "\n".join(f"  {name}" for name in list_system_files())
        + "\n\nexamples:\n"
        "  %(prog)s isolation --duration 60 --requirements requirements.toml\n"
        "  %(prog)s pointing --parameters my.ssv --faults tracker_loses_lock.json --output results/mine\n"
        "  %(prog)s other.ssp --duration 10 --step 1e-3 --observe 'motor.*'"
    )
    p.add_argument(
        "what", nargs="?", default="isolation", metavar="SCENARIO|SYSTEM",
        help="name of a scenario in the list below (%(default)s), or file or folder of any other system",
    )  # fmt: skip
    _add_what(p.add_argument_group("what is run"))
    _add_times(p.add_argument_group("time"))
    _add_acting(p.add_argument_group("what acts"))
    robust = p.add_argument_group("robustness")
    add_isolation_options(robust)
    add_checkpoint_options(robust)
    robust.add_argument(
        "--resume", type=read_output, metavar="DIR",
        help="continue the run whose results are in DIR from its last checkpoint, with the same options",
    )  # fmt: skip
    _add_results(p.add_argument_group("results"))
    add_scheme_options(p)


def _add_what(group: argparse._ArgumentGroup) -> None:
    system = group.add_mutually_exclusive_group()
    add_system_options(system, "system", default="that of the scenario")
    system.add_argument(
        "--ssp", dest="system", type=Path, metavar="FILE.ssp",
        help="archive with the system and its FMUs, as ps-fmu ssp writes it",
    )  # fmt: skip
    add_system_options(group, "instrument", "parameters", "replace", "fmus", parameters="parameter_files")
    group.add_argument(
        "--apart", nargs="+", action="extend", default=[], metavar="NAME",
        help="do not warn that these parameters differ from those of the plant; a NAME may be the beginning of others, "
        "such as isolator.payload",
    )  # fmt: skip
    group.add_argument(
        "--outside", action="store_true", help="let the system use files outside of its folder or archive"
    )


def _add_times(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--duration", type=float, metavar="S", help="simulated time of each case in seconds")
    group.add_argument("--step", type=float, metavar="S", help="communication step in seconds")
    group.add_argument("--storage-step", type=float, metavar="S", help="seconds between stored rows")


def _add_acting(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--seed", type=int, metavar="N", help="seed of the random disturbance (of scenarios: 1)")
    group.add_argument(
        "--disturbance", type=Path, metavar="FILE",
        help="recorded force and torque on the bus, CSV or netCDF, in place of the noise",
    )  # fmt: skip
    group.add_argument(
        "--input", dest="inputs", type=Path, metavar="F.csv",
        help="inputs over time: a CSV file with the columns time, in seconds, and names of inputs",
    )  # fmt: skip
    group.add_argument(
        "--faults", type=Path, metavar="FILE",
        help="JSON or YAML in libcosim's grammar: signals that freeze, drop out, get noise, ... at given times",
    )  # fmt: skip


def _add_results(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--output", type=read_output, metavar="DIR", help="folder of the results (results/SCENARIO, results/SYSTEM)"
    )
    group.add_argument(
        "--observe", action="append", default=[], metavar="PATTERN",
        help="store only the outputs that fit the pattern, such as 'plant.payload_*'; may be repeated. Statistics, "
        "indices and verdicts do not change. Without a scenario the pattern finds parameters and local variables, too",
    )  # fmt: skip
    group.add_argument(
        "--requirements", type=Path, metavar="F.toml", help="pointing requirements; exit code 1 if one is not met"
    )
    group.add_argument(
        "--profile", action="store_true",
        help="measure the time of each FMU, of the exchange and of the observers, and the longest step",
    )  # fmt: skip
    group.add_argument(
        "--no-figures", dest="figures", action="store_false",
        help="draw no PNG files: the report has its charts, and no still pictures",
    )  # fmt: skip


def read_options(arguments: argparse.Namespace) -> RunOptions:
    """Checked options, with an output folder that can be written.  Raises OptionError."""
    try:
        scheme = read_scheme(arguments)
    except UsageError as error:
        raise OptionError(str(error)) from error
    given = {name: value for name, value in vars(arguments).items() if name not in _NOT_GIVEN}
    given["isolate"] = arguments.isolate or arguments.isolate_only
    return make_options(arguments.what, _choose_output(arguments), scheme=scheme, **given).claim_output()


def read_resumed(arguments: argparse.Namespace, defaults: argparse.Namespace) -> RunOptions:
    """The options of the run to go on with.  Raises OptionError, also for an option that is given besides."""
    given = vars(arguments) | {"resume": None, "figures": True}
    if others := [name for name, value in given.items() if name in defaults and value != getattr(defaults, name)]:
        raise OptionError(
            "--resume: a resumed run keeps its options, and "
            f"{name_option(others[0])} is refused. To change an option, begin a run --from its checkpoint"
        )
    options = read_run(claim_folder(arguments.resume.absolute()))
    return options if arguments.figures else replace(options, figures=False)


def _choose_output(arguments: argparse.Namespace) -> Path:
    """Folder of the results, which may not be there."""
    if arguments.resume is not None or arguments.output is not None:
        return Path(arguments.resume or arguments.output)
    return Path("results", arguments.what if arguments.what in SCENARIOS else Path(arguments.what).stem)


def main(arguments: Sequence[str] | None = None, program: str = "run.py") -> int:
    """Run what the arguments name; returns the exit code.  ``program``: what it is called in messages."""
    command_line = argparse.ArgumentParser(prog=program)
    add_arguments(command_line)
    return run(command_line.parse_args(arguments), command_line)


def run(arguments: argparse.Namespace, command_line: argparse.ArgumentParser) -> int:
    """Run what parsed arguments name; returns the exit code.  ``command_line``: the parser, for its errors."""
    program = command_line.prog
    with leave_no_empty_folder(_choose_output(arguments)), ExitStack() as stack:
        try:
            if arguments.resume is not None:
                options = read_resumed(arguments, command_line.parse_args([]))
            else:
                options = read_options(arguments)
            stack.enter_context(hold_folder(options.output, options.resume))
        except OptionError as error:
            command_line.error(str(error))
        except OSError as error:  # the product's files or the user's home are not there, or no file has such a name
            print(f"{program}: {reason(error)}", file=sys.stderr)
            return 2 if error.errno == errno.ENAMETOOLONG else 1
        try:
            build_fmus(options)
            done = execute(options)
        except KeyboardInterrupt:
            return report_end(program, "interrupted", options.output, 130)
        except OptionError as error:  # one that needs the system to be seen, such as a path that takes longer
            command_line.error(str(error))
        except (BuildError, CosimError, OSError, ValueError) as error:
            return report_end(program, reason(error) + _suggest_folder(options, error), options.output, 1, error)
    if done.failures:
        print(f"{program}: {done.failures}\n{program}: all results are written: {options.output}", file=sys.stderr)
        return 1
    return 0


def _suggest_folder(options: RunOptions, error: Exception) -> str:
    """What to type for an FMU that is not where the system says."""
    if not isinstance(error, MissingFmuError) or options.system.suffix.lower() not in (".ssd", ".xml"):
        return ""
    what = [str(options.system)] if options.is_plain else [options.scenario.name, "--system", str(options.system)]
    return f"\n{shlex.join(['ps-fmu', 'run', *what, '--fmus'])} DIR takes FMUs by their file names from a folder"
