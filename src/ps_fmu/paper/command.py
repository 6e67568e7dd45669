"""``ps-fmu analyse NAME``: the analyses, and what they have in common on the command line."""

from __future__ import annotations

import argparse
import importlib
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..terminal import reason

if TYPE_CHECKING:
    from .result import Analysis

#: Name -> what it is about.  Each is a module of this package with ``analyse(options) -> Analysis``.
ANALYSES = {
    "workspace": "Table 1 and Fig 6: the orientations within reach, singular values of the Jacobian",
    "trajectories": "Fig 7 and Table 1 through commander and plant: errors along paths, the limits of the angles",
    "transmissibility": "Figs 8 and 11: singular values in closed form, and as measured on the running FMUs at each "
    "orientation and in each case (132 runs, about 2 minutes on two cores)",
    "stability": "Fig 10: the internal loop with delay, in the paper's reading and in that of its equation (48)",
    "jitter": "Table 2 and Fig 9: RMS, rejection and image point, in closed form and co-simulated",
    "paper": "every published number beside ours, and the errata with their evidence: all analyses together",
}
#: The modules of those, in this package.
MODULES = {
    "workspace": "figures.fig06.analysis",
    "trajectories": "figures.fig07.analysis",
    "transmissibility": "figures.fig08_11.analysis",
    "stability": "figures.fig10.analysis",
    "jitter": "figures.table2.analysis",
    "paper": "whole",
}
#: Those that need neither FMUs nor a system description.
CLOSED_FORM = ("workspace",)


@dataclass(frozen=True)
class Options:
    """What every analysis is told."""

    output: Path
    """Folder of the results; it exists."""
    fmus: Path = Path("build/fmus")
    """The built FMUs."""
    system: Path = Path("system/SystemStructure.ssd")
    seed: int = 1
    progress: bool = True
    """Show progress bars on stderr."""


def add_parser(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """The subcommand ``analyse`` with one subcommand for each of :data:`ANALYSES`."""
    analyse = commands.add_parser("analyse", help="the paper's numbers and figures, recomputed")
    names = analyse.add_subparsers(title="analyses", required=True, metavar="NAME", dest="analysis")
    for name, what in ANALYSES.items():
        parser = names.add_parser(name, help=what, description=what)
        parser.add_argument("--output", type=Path, metavar="DIR", help=f"folder of the results (results/{name})")
        parser.add_argument("--fmus", type=Path, default=Options.fmus, metavar="DIR", help="default: %(default)s")
        parser.add_argument("--system", type=Path, default=Options.system, metavar="F.ssd", help="default: %(default)s")
        parser.add_argument("--seed", type=int, default=Options.seed, metavar="N", help="default: %(default)s")
        parser.set_defaults(run=run)


def run(arguments: argparse.Namespace) -> int:
    """Run the analysis that the arguments name, write and print its results; the exit code."""
    from ..cosim.errors import CosimError
    from ..runs.options import OptionError, claim_folder
    from ..slavekit.pack.build import BuildError
    from .cosimulation import check_sources
    from .terminal import printed

    name = arguments.analysis
    output = arguments.output if arguments.output is not None else Path("results", name)
    try:
        if name not in CLOSED_FORM:
            check_sources(arguments.system)
        claim_folder(output)
        progress = sys.stderr is not None and sys.stderr.isatty()
        options = Options(output, arguments.fmus, arguments.system, arguments.seed, progress)
        analysis: Analysis = importlib.import_module(f".{MODULES[name]}", __package__).analyse(options)
        analysis.write(output)
    except OptionError as error:
        print(f"ps-fmu analyse {name}: {error}", file=sys.stderr)
        return 2
    except (BuildError, CosimError, OSError, ValueError) as error:
        print(f"ps-fmu analyse {name}: {reason(error)}", file=sys.stderr)
        return 1
    print(printed(analysis), f"results in {output}", sep="\n")
    return 0
