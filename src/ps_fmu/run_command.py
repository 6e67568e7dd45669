"""``ps-fmu run SCENARIO``, and the same as ``python system/run.py SCENARIO`` in a checkout.

``ps-fmu run FILE.ssp``, for any system, is :mod:`.system_command`.

Exit codes: 0 done, 1 the run failed or a requirement is not met, 2 an argument cannot be used, 130 interrupted by
Ctrl-C or SIGTERM (results so far are kept).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import fields
from pathlib import Path

from .cosim.checkpoint import add_checkpoint_options
from .cosim.errors import CosimError, UsageError
from .cosim.isolation.instance import add_isolation_options, read_isolation
from .cosim.ssp.reading import read_system
from .cosim.structure import suggest_names
from .product.files import find_file, find_product, list_system_files
from .results.style import prepare_drawing
from .runs.built_fmus import find_built_folder, provide_fmus
from .runs.execute import run_scenario
from .runs.faults_option import add_faults_option, find_faults
from .runs.keeping import keep_run
from .runs.kept_options import SCENARIO, name_option, read_run
from .runs.options import REPORT, SCHEMES, AnyRun, OptionError, RunOptions, claim_folder
from .runs.output import hold_folder, leave_no_empty_folder, report_end
from .runs.scenario import SCENARIOS, Scenario
from .slavekit.pack.errors import BuildError
from .terminal import read_output, reason

_PLANT = "plant"  # the component that all scenarios need
ABOUT = "Run a scenario of the pointing manipulator: FMUs, wired as a system description (.ssd) says."


def add_arguments(p: argparse.ArgumentParser) -> None:
    """Add the arguments of a run, and a list of the scenarios, to a parser."""
    listing = "\n".join(
        f"  {name:14}{scenario.about}\n{'':16}--duration {scenario.duration_s:g} --step {scenario.step_s:g} "
        f"--storage-step {scenario.storage_step_s:g}"
        for name, scenario in SCENARIOS.items()
    )
    p.formatter_class = argparse.RawDescriptionHelpFormatter
    p.description = ABOUT
    p.usage = "%(prog)s [SCENARIO | SYSTEM.ssp|.ssd|.xml | FMU.fmu] [options]"
    p.epilog = (
        f"scenarios and their defaults:\n{listing}\n\n"
        "files of ps_fmu that --system, --parameters, --requirements and --faults take by name, where no file of yours "
        "has it:\n"
        + "\n".join(f"  {name}" for name in list_system_files())
        + "\n\nany other system, or an FMU, has other options: %(prog)s SYSTEM.ssd --help lists them\n\n"
        "examples:\n"
        "  %(prog)s isolation --duration 60 --requirements requirements.toml\n"
        "  %(prog)s pointing --parameters my.ssv --faults tracker_loses_lock.json --output results/mine\n"
        "  %(prog)s other.ssp --duration 10 --step 1e-3"
    )
    p.add_argument(
        "scenario", nargs="?", default="isolation", type=_read_scenario, metavar="SCENARIO",
        help="one of those below (%(default)s), or a file: any other system",
    )  # fmt: skip
    _add_what(p.add_argument_group("what is run"))
    _add_times(p.add_argument_group("time"))
    _add_acting(p.add_argument_group("what acts"))
    robust = p.add_argument_group("robustness")
    add_isolation_options(robust)
    add_checkpoint_options(robust)
    robust.add_argument(
        "--resume", type=read_output, metavar="DIR",
        help="go on with the run whose results are in DIR, from its last checkpoint, with the options that it has",
    )  # fmt: skip
    _add_results(p.add_argument_group("results"))


def _read_scenario(text: str) -> str:
    if text not in SCENARIOS:
        hint = suggest_names(text, SCENARIOS)
        raise argparse.ArgumentTypeError(f"there is no scenario {text!r}{hint} (there are {', '.join(SCENARIOS)})")
    return text


def _add_what(group: argparse._ArgumentGroup) -> None:
    system = group.add_mutually_exclusive_group()
    system.add_argument("--ssp", type=Path, metavar="FILE.ssp", help="the system with its FMUs, made by ps-fmu ssp")
    system.add_argument(
        "--system", type=Path, metavar="FILE.ssd",
        help="another system than that of the scenario; FMUs that ps_fmu has not are found by their source",
    )  # fmt: skip
    group.add_argument(
        "--parameters", type=Path, nargs="+", action="extend", default=[], metavar="F.ssv",
        help="files with other values, by component.parameter; later ones win",
    )  # fmt: skip
    group.add_argument(
        "--apart", nargs="+", action="extend", default=[], metavar="NAME",
        help="parameters, or beginnings of their names such as isolator.payload, that differ from the plant's on "
        "purpose: no warning",
    )  # fmt: skip


def _add_times(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--duration", type=float, metavar="S", help="seconds to simulate and judge, per run")
    group.add_argument("--step", type=float, metavar="S", help="communication step in seconds")
    group.add_argument("--storage-step", type=float, metavar="S", help="seconds between stored rows")
    group.add_argument("--scheme", choices=SCHEMES, default=SCHEMES[0], help="order of exchange (%(default)s)")


def _add_acting(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the disturbance (%(default)s)")
    group.add_argument(
        "--disturbance", type=Path, metavar="FILE",
        help="recorded force and torque on the bus, CSV or netCDF, in place of the noise",
    )  # fmt: skip
    add_faults_option(group)


def _add_results(group: argparse._ArgumentGroup) -> None:
    group.add_argument("--output", type=read_output, metavar="DIR", help="folder of the results (results/SCENARIO)")
    group.add_argument(
        "--observe", action="append", default=[], metavar="PATTERN",
        help="store these outputs alone, as 'plant.payload_*'; may be repeated. Statistics, indices and verdicts stay",
    )  # fmt: skip
    group.add_argument(
        "--requirements", type=Path, metavar="F.toml", help="pointing requirements; exit code 1 if one is not met"
    )
    group.add_argument(
        "--profile", action="store_true",
        help="say where the time goes: each FMU, the exchange, the observers, the longest step and when it was",
    )  # fmt: skip
    group.add_argument(
        "--no-figures", dest="figures", action="store_false",
        help="draw no PNG files; the report keeps its charts, and has no pictures",
    )  # fmt: skip


def read_options(scenario: Scenario, arguments: argparse.Namespace) -> RunOptions:
    """Checked options, with an output folder that can be written.  Raises OptionError."""
    duration, step = arguments.duration, arguments.step
    try:
        isolation = read_isolation(arguments)
    except UsageError as error:
        raise OptionError(str(error)) from error
    own = arguments.ssp or (arguments.system and find_file(arguments.system))
    return RunOptions(
        scenario=scenario,
        system=own or find_product().system / scenario.system,
        output=_choose_output(arguments),
        duration_s=duration if duration is not None else scenario.duration_s,
        step_s=step if step is not None else scenario.step_s,
        seed=arguments.seed,
        parameters=tuple(map(find_file, arguments.parameters)),
        apart=tuple(arguments.apart),
        scheme=arguments.scheme,
        storage_step_s=arguments.storage_step,
        requirements=arguments.requirements and find_file(arguments.requirements),
        disturbance=arguments.disturbance,
        observe=tuple(arguments.observe),
        fmus=None if arguments.ssp else find_built_folder(),
        figures=arguments.figures,
        profile=arguments.profile,
        isolation=isolation,
        faults=find_faults(arguments.faults),
        checkpoint_s=arguments.checkpoint,
        source=arguments.source,
        anew=tuple(arguments.anew),
    ).claim_output()


def read_resumed(arguments: argparse.Namespace, defaults: argparse.Namespace) -> RunOptions | AnyRun:
    """The options of the run to go on with.  Raises OptionError, also for an option that is given besides."""
    given = vars(arguments) | {"resume": None, "figures": True}
    if others := [name for name, value in given.items() if name in defaults and value != getattr(defaults, name)]:
        raise OptionError(
            "--resume: the run goes on with the options that it has, so that "
            f"{name_option(others[0])} cannot be given: to change something, begin a run --from its checkpoint"
        )
    kept = read_run(claim_folder(arguments.resume.absolute()))
    options = {**kept.options, "resume": True}
    if not arguments.figures:
        options["figures"] = False
    scenario = SCENARIOS.get(kept.name) if kept.kind == SCENARIO else None
    if kept.kind == SCENARIO and scenario is None:
        raise OptionError(f"--resume: there is no scenario {kept.name!r} any longer")
    try:
        return AnyRun(**options) if scenario is None else RunOptions(scenario=scenario, **options)
    except TypeError as error:
        where = kept.options["output"]
        raise OptionError(f"--resume: the options of the run in {where} are damaged: {error}") from error


def _choose_output(arguments: argparse.Namespace) -> Path:
    """Folder of the results, which may not be there."""
    return Path("results", arguments.scenario) if arguments.output is None else Path(arguments.output)


def build_and_run(options: RunOptions, show: Callable[[str], None] = print) -> None:
    """Run the scenario of the options; writes the results and shows the table.

    The output folder is held by :func:`ps_fmu.runs.output.hold_folder`.  If the options name a folder of FMUs, the
    product's are built there first, where they are missing or older than their sources.

    Raises
    ------
    OptionError: an option cannot be honoured, as the system shows.
    BuildError, CosimError, OSError, ValueError: the FMUs cannot be built or run, or results cannot be written.
    """
    if options.fmus is not None:
        provide_fmus(options.fmus, options.system)
    if options.figures:
        prepare_drawing()
    kept = {field.name: getattr(options, field.name) for field in fields(options)}
    with keep_run(options.output, SCENARIO, options.scenario.name, kept, last=REPORT, resume=options.resume):
        run_scenario(options, show)


def main(arguments: Sequence[str] | None = None, program: str = "run.py") -> int:
    """Run the scenario that the arguments name; returns the exit code.  ``program``: what it is called in messages."""
    command_line = argparse.ArgumentParser(prog=program)
    add_arguments(command_line)
    return run(command_line.parse_args(arguments), command_line)


def run(arguments: argparse.Namespace, command_line: argparse.ArgumentParser) -> int:
    """Run the scenario of parsed arguments; returns the exit code.  ``command_line``: the parser, for its errors."""
    program = command_line.prog
    with leave_no_empty_folder(arguments.resume or _choose_output(arguments)), ExitStack() as stack:
        try:
            if arguments.resume is not None:
                options = read_resumed(arguments, command_line.parse_args([]))
                if isinstance(options, AnyRun):
                    from .system_command import run_system

                    return run_system(options, program)
            else:
                options = read_options(SCENARIOS[arguments.scenario], arguments)
            stack.enter_context(hold_folder(options.output, options.resume))
        except OptionError as error:
            command_line.error(str(error))
        except OSError as error:  # the product's files or the user's home are not there
            print(f"{program}: {reason(error)}", file=sys.stderr)
            return 1
        try:
            build_and_run(options)
        except KeyboardInterrupt:
            return report_end(program, "interrupted", options.output, 130)
        except OptionError as error:  # one that needs the system to be seen, such as a path that takes longer
            command_line.error(str(error))
        except (BuildError, CosimError, OSError, ValueError) as error:
            return report_end(program, reason(error) + _suggest_other(options), options.output, 1, error)
    return 0


def _suggest_other(options: RunOptions) -> str:
    """What runs a system that is not of the pointing manipulator; nothing for one that is, or cannot be read."""
    try:
        names = {component.name for component in read_system(options.system, options.fmus, lenient=True).components}
    except (CosimError, OSError):
        names = {_PLANT}
    if _PLANT in names:
        return ""
    return f"\nThe system has no {_PLANT!r}, which scenarios need: ps-fmu run {options.system} runs any system"
