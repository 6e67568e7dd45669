"""``ps-fmu analyse NAME``: runs an analysis of the paper, or one that answers a question of design.

Exit codes: 0 done, 1 the analysis failed, 2 an argument cannot be used, 130 interrupted by Ctrl-C or SIGTERM (what is
written is kept).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .analyses.table import ANALYSES, Analysis, AnalysisOptions
from .product.files import find_file, find_product
from .runs.built_fmus import choose_fmus
from .system_commands import OPTIONS, add_system_options
from .terminal import read_output, reason

if TYPE_CHECKING:
    from .analyses.result import AnalysisResult

_OPTIONS: dict[str, dict[str, Any]] = {
    "requirements": {"type": Path, "metavar": "F.toml", "help": "default: requirements.toml of ps_fmu"},
    "disturbance": {
        "type": Path, "metavar": "FILE.csv", "help": "recorded force and torque on the bus in place of the noise",
    },
    "uncertainty": {
        "type": float, "nargs": "+", "default": [], "metavar": "X",
        "help": "factors on the amplitude and between them the limits of their bands in Hz: 2 10 1.5 50 1.2",
    },
}  # fmt: skip


def add_arguments(analyse: argparse.ArgumentParser) -> None:
    """Add a subcommand of ``analyse`` for each analysis."""
    names = analyse.add_subparsers(title="analyses", required=True, metavar="NAME", dest="analysis")
    default = "default: %(default)s"
    for name, analysis in ANALYSES.items():
        parser = names.add_parser(name, help=analysis.about, description=analysis.about)
        parser.add_argument("--output", type=read_output, metavar="DIR", help=f"folder of the results (results/{name})")
        common = [name for name in OPTIONS if name in ("system", "fmus", *analysis.takes)]
        add_system_options(parser, *common, default=f"{analysis.system} of ps_fmu")
        parser.add_argument("--seed", type=int, default=AnalysisOptions.seed, metavar="N", help=default)
        for option in (name for name in analysis.takes if name in _OPTIONS):
            parser.add_argument(f"--{option}", **_OPTIONS[option])
        parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the analysis that the arguments name, write and print its results; returns the exit code."""
    from .cosim.errors import CosimError
    from .runs.options import OptionError
    from .runs.output import leave_no_empty_folder
    from .slavekit.pack.errors import BuildError

    name = arguments.analysis
    output = arguments.output if arguments.output is not None else Path("results", name)
    before = _list_files(output)
    with leave_no_empty_folder(output):
        try:
            result = _analyse(ANALYSES[name], arguments, output)
        except OptionError as error:
            why, code = str(error), 2
        except KeyboardInterrupt:
            why, code = "interrupted", 130
        except (BuildError, CosimError, OSError, ValueError) as error:
            why, code = reason(error), 1
        else:
            why, code = "", 0
    if code:
        kept = [f"results so far are in {output}"] if _list_files(output) - before else []
        print(*(f"ps-fmu analyse {name}: {line}" for line in (why, *kept)), sep="\n", file=sys.stderr)
        return code
    print(result.to_text(), f"results in {output}", sep="\n")
    return 0


def _analyse(analysis: Analysis, arguments: argparse.Namespace, output: Path) -> AnalysisResult:
    """Check the arguments, run the analysis and write its files."""
    from .analyses.system import check_sources
    from .runs.options import check_seed, claim_folder

    check_seed(arguments.seed)
    product = find_product()
    system = product.system / analysis.system if arguments.system is None else find_file(arguments.system)
    fmus = choose_fmus(system, arguments.fmus)
    if analysis.needs_fmus:
        check_sources(system)
    claim_folder(output)
    progress = sys.stderr is not None and sys.stderr.isatty()
    options = _read_options(arguments, output, fmus, system, progress)
    others = system.resolve() != (product.system / analysis.system).resolve()
    given = options.instrument, options.parameters, options.replace, options.disturbance
    own = any(given) or others
    result = analysis.load(own=own)(options)
    result.write(output)
    return result


def _list_files(output: Path) -> set[tuple[Path, int]]:
    """The result files in a folder, which may not be there, and when they were written."""
    return {(path, path.stat().st_mtime_ns) for path in output.glob("*.json")}


def _read_options(
    arguments: argparse.Namespace, output: Path, fmus: Path | None, system: Path, progress: bool
) -> AnalysisOptions:
    from .runs.options import read_replacements

    requirements, instrument = (getattr(arguments, name, None) for name in ("requirements", "instrument"))
    return AnalysisOptions(
        output,
        fmus,
        system,
        arguments.seed,
        progress,
        instrument=None if instrument is None else find_file(instrument),
        replace=read_replacements(getattr(arguments, "replace", ())),
        parameters=tuple(find_file(path) for path in getattr(arguments, "parameters", ())),
        requirements=None if requirements is None else find_file(requirements),
        disturbance=getattr(arguments, "disturbance", None),
        uncertainty=tuple(getattr(arguments, "uncertainty", ())),
    )
