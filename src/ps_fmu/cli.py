"""The command ``ps-fmu``.

A subcommand is a function that takes the parsed arguments and returns an exit code.  What users can put right
is printed in one line without a traceback.
"""

from __future__ import annotations

import argparse
import errno
import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

from . import __version__
from .child_processes import use_one_thread
from .product.files import find_product
from .runs.built_fmus import find_built_folder, provide_fmus
from .system_commands import add_parsers as add_system_commands
from .system_commands import add_system_options
from .terminal import LazyParser, group_commands, read_output, reason, run_command

EXIT_OK = 0
EXIT_FAILED = 1
EXIT_REFUSED = 2  # as argparse on arguments that it does not understand
EXIT_INTERRUPTED = 130

_LISTED = (
    ("analyse", "the paper's numbers and figures, recomputed; design trades", "ps_fmu.analyse_command"),
    ("identify", "find a parameter set from the published numbers", "ps_fmu.paper.identification.identify_command"),
    ("judge", "judge stored results by requirements", "ps_fmu.judge_command"),
    ("sweep", "run a study of many cases", "ps_fmu.sweep_command"),
)
"""Commands that are imported when they are used: name, words of the help, module with ``add_arguments``."""
_GROUPS = {
    "run and judge": ("run", "judge", "sweep", "analyse"),
    "my instrument": ("parameters", "list", "ssp", "new"),
    "build and check FMUs": ("build", "wrap", "check", "crosscheck"),
    "the paper": ("identify",),
}
"""The commands by what a person wants, in the order of the help."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; the exit code."""
    return run_command(lambda: _command(arguments))


def _command(arguments: Sequence[str] | None) -> int:
    use_one_thread()
    try:
        options = parser().parse_args(arguments)
        code: int = options.run(options)
        return code
    except KeyboardInterrupt:
        print("ps-fmu: interrupted", file=sys.stderr)
        return EXIT_INTERRUPTED
    except OSError as error:
        if error.errno == errno.ENAMETOOLONG:
            print(f"ps-fmu: {reason(error)}", file=sys.stderr)
            return EXIT_REFUSED
        if not isinstance(error, FileNotFoundError) or error.filename is not None:
            raise
        # Only the working directory has no name: a relative path was to be found from it.
        print("ps-fmu: the working directory has been removed: change to one that exists", file=sys.stderr)
        return 1


def parser() -> argparse.ArgumentParser:
    """The command line's grammar."""
    about = "FMUs of a pointing manipulator."
    top = argparse.ArgumentParser(prog="ps-fmu", description=about, formatter_class=group_commands(_GROUPS))
    top.add_argument("--version", action="version", version=f"ps-fmu {__version__}")
    top.add_argument(
        "--print-completion", action=_PrintCompletion, choices=("bash", "zsh"), metavar="SHELL",
        default=argparse.SUPPRESS,
        help="print the script by which bash or zsh completes names and options, see docs/first-run.md",
    )  # fmt: skip
    commands: argparse._SubParsersAction[Any] = top.add_subparsers(
        title="commands", required=True, metavar="COMMAND", parser_class=LazyParser
    )
    _add_run(commands)
    _add_build(commands)
    _add_wrap(commands)
    _add_check(commands)
    add_system_commands(commands)
    _add_crosscheck(commands)
    _add_listed(commands)
    return top


class _PrintCompletion(argparse.Action):
    """Prints the completion of all commands for a shell, and ends."""

    def __call__(self, parser: argparse.ArgumentParser, *given: Any) -> None:
        import shtab

        for action in parser._actions:
            for command in action.choices.values() if isinstance(action, argparse._SubParsersAction) else ():
                if isinstance(command, LazyParser):
                    command.complete(())
        print(shtab.complete(parser, given[1]))
        parser.exit()


def _add_run(commands: argparse._SubParsersAction[LazyParser]) -> None:
    run = commands.add_parser("run", help="run a scenario of the whole system, or any .ssp, .ssd or .fmu")

    def fill(parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
        from . import run_command as command

        command.add_arguments(parser)
        parser.set_defaults(run=lambda options: command.run(options, parser))

    run.fill = fill


def _add_listed(commands: argparse._SubParsersAction[LazyParser]) -> None:
    def fill(module: str, parser: argparse.ArgumentParser, arguments: Sequence[str]) -> None:
        import_module(module).add_arguments(parser)

    for name, about, module in _LISTED:
        commands.add_parser(name, help=about).fill = partial(fill, module)


def _add_build(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    build = commands.add_parser(
        "build",
        help="build FMUs from Python slaves",
        description="Build an FMU from a script with a pythonfmu.Fmi2Slave, or without a script the FMUs of ps_fmu.  "
        "The command runs the code of the slave.",
    )
    build.add_argument(
        "script", type=Path, nargs="?", metavar="SLAVE.py",
        help="Python file of the slave; modules beside it go into the FMU",
    )  # fmt: skip
    build.add_argument("files", type=Path, nargs="*", metavar="FILE", help="other files and folders that it needs")
    build.add_argument(
        "--output", type=read_output, metavar="DIR", help="default: build/fmus, for a script the current folder"
    )
    build.add_argument(
        "--only", action="append", default=[], metavar="NAME", help="build only the FMU of this folder; may be repeated"
    )
    build.add_argument(
        "--fmus", type=Path, metavar="DIR", help="folder of the sources (default: those of ps_fmu)"
    )
    _add_python_options(build)
    build.set_defaults(run=_build)


def _add_python_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--interpreter",
        type=Path,
        metavar="PYTHON",
        help="write the path of this Python into the FMU, for hosts without Python; it then runs on this machine only",
    )
    parser.add_argument(
        "--bundle", action="store_true", help="put a Python and the packages of the slave into the FMU (8 to 60 MB)"
    )


def _build(options: argparse.Namespace) -> int:
    from .slavekit.pack.build import build_one, find_folders
    from .slavekit.pack.errors import BuildError
    from .slavekit.pack.foreign import build_script

    python = {"interpreter": options.interpreter, "bundled": options.bundle}
    try:
        if options.script is not None:
            if options.only or options.fmus is not None:
                raise BuildError("expected either a script, or --only and --fmus")
            _print_fmu(*build_script(options.script, options.files, options.output or Path(), **python))
            return EXIT_OK
        for folder in find_folders(options.fmus or find_product().fmus, options.only):
            _print_fmu(build_one(folder, options.output or Path("build/fmus"), **python))
    except (BuildError, OSError) as error:
        print(f"ps-fmu build: {reason(error)}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


def _add_wrap(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    wrap = commands.add_parser(
        "wrap",
        help="make an FMU of pythonfmu load in any host",
        description="Put the launcher in front of an FMU that 'pythonfmu build' has made: it then loads in hosts that "
        "do not run Python.  This runs the code of the FMU.",
    )
    wrap.add_argument("fmu", type=Path, metavar="IN.fmu")
    wrap.add_argument("--output", type=read_output, required=True, metavar="OUT.fmu", help="new file, or its folder")
    _add_python_options(wrap)
    wrap.set_defaults(run=_wrap)


def _wrap(options: argparse.Namespace) -> int:
    from .slavekit.pack.errors import BuildError
    from .slavekit.pack.foreign import wrap

    try:
        _print_fmu(*wrap(options.fmu, options.output, interpreter=options.interpreter, bundled=options.bundle))
    except (BuildError, OSError) as error:
        print(f"ps-fmu wrap: {reason(error)}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


def _print_fmu(fmu: Path, remarks: Sequence[str] = ()) -> None:
    for remark in remarks:
        print(f"{fmu.name}: {remark}", file=sys.stderr)
    print(f"{fmu}  {fmu.stat().st_size / 1e3:.0f} kB", flush=True)


def _add_check(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    check = commands.add_parser(
        "check",
        help="check FMU files of any maker",
        description="Check archive, model description and behaviour of FMUs.  The command loads the library of each "
        "FMU and runs its code with your rights.  With --no-run it only reads the files.  The exit code is 1 if a "
        "check FAILED; a warning is no failure.",
    )
    check.add_argument("--no-run", action="store_true", help="check archive and model description only; run no code")
    check.add_argument("fmus", type=Path, nargs="+", metavar="FMU")
    check.set_defaults(run=_check)


def _check(options: argparse.Namespace) -> int:
    from .fmucheck.fmu_check import check_fmu
    from .fmucheck.verdicts import write_table

    good = [
        write_table(str(path), check_fmu(path, run=not options.no_run), lambda line: print(line, flush=True))
        for path in options.fmus
    ]
    return EXIT_OK if all(good) else EXIT_FAILED


def _add_crosscheck(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    crosscheck = commands.add_parser(
        "crosscheck",
        help="compare the FMUs with their reference runs",
        description="Run each FMU with its inputs and options (FMI cross-check rules 4.1) and compare.",
    )
    add_system_options(crosscheck, "fmus")
    crosscheck.add_argument(
        "--references",
        type=Path,
        metavar="DIR",
        help="folder whose folders hold <Model>_ref.opt (default: the sources of ps_fmu)",
    )
    crosscheck.add_argument("--write", action="store_true", help="write new reference solutions instead")
    crosscheck.set_defaults(run=_crosscheck)


def _crosscheck(options: argparse.Namespace) -> int:
    from .fmucheck import crosscheck
    from .slavekit.pack.errors import BuildError

    failed = False
    try:
        if options.write and options.references is None and not find_product().in_checkout:
            raise BuildError("--write: name the folder to write into with --references")
        references = crosscheck.find_references(options.references or find_product().fmus)
        fmus = options.fmus or find_built_folder()
        if options.fmus is None:
            provide_fmus(fmus)
        for reference in references:
            fmu = fmus / f"{reference.model}.fmu"
            result = crosscheck.simulate(fmu, reference)
            if options.write:
                crosscheck.write_signals(reference.results, result)
                print(f"{reference.results}  {len(result)} rows", flush=True)
                continue
            tolerance = crosscheck.read_options(reference.options).relative_tolerance
            deviation = crosscheck.find_deviation(result, crosscheck.read_signals(reference.results))
            failed |= deviation > tolerance
            verdict = "agrees" if deviation <= tolerance else "DIFFERS"
            difference = f"relative deviation {deviation:.1e}, allowed {tolerance:.1e}"
            print(f"{reference.model:24}{verdict}  {difference}", flush=True)
    except (crosscheck.CrossCheckError, BuildError, OSError) as error:
        print(f"ps-fmu crosscheck: {reason(error)}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_FAILED if failed else EXIT_OK


if __name__ == "__main__":
    sys.exit(main())
