"""Runs a scenario of the pointing manipulator: four FMUs, wired as SystemStructure.ssd says.

Writes summary.json, results.nc, figures and report.html into the output folder.
Exit codes: 0 done, 1 the run failed or a requirement is not met, 2 an argument cannot be used, 130 interrupted by
Ctrl-C or SIGTERM (results so far are kept).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

try:
    from ps_fmu.cosim.errors import CosimError
    from ps_fmu.paper import figures
    from ps_fmu.runs import scenarios
    from ps_fmu.runs.built_fmus import ensure_built
    from ps_fmu.runs.options import RESULTS, SCHEMES, OptionError, RunOptions, Scenario
    from ps_fmu.runs.output import hold_folder
    from ps_fmu.runs.registry import find_scenarios
    from ps_fmu.slavekit.pack.build import BuildError
    from ps_fmu.terminal import reason, run_command
except KeyboardInterrupt:
    sys.exit(130)
except ModuleNotFoundError as missing:
    sys.exit(f"{missing}: run `make run` once, then use .venv/bin/python system/run.py")


def make_parser(found: Mapping[str, Scenario]) -> argparse.ArgumentParser:
    """The command line, with the scenarios by name."""
    listing = "\n".join(
        f"  {name:14}{scenario.about}\n{'':16}--duration {scenario.duration_s:g} --step {scenario.step_s:g} "
        f"--storage-step {scenario.storage_step_s:g}"
        for name, scenario in found.items()
    )
    p = argparse.ArgumentParser(
        prog="run.py",
        description=__doc__.splitlines()[0] if __doc__ else None,
        epilog=f"scenarios and their defaults:\n{listing}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    p.add_argument("scenario", nargs="?", default="isolation", choices=list(found))
    p.add_argument("--duration", type=float, metavar="S", help="seconds to simulate and judge, per run")
    p.add_argument("--step", type=float, metavar="S", help="communication step in seconds")
    p.add_argument("--seed", type=int, default=1, metavar="N", help="seed of the disturbance (%(default)s)")
    p.add_argument(
        "--parameters", type=Path, nargs="+", action="extend", default=[], metavar="F.ssv",
        help="files with other values, by component.parameter; later ones win",
    )  # fmt: skip
    p.add_argument(
        "--apart", nargs="+", action="extend", default=[], metavar="NAME",
        help="parameters, or beginnings of their names such as isolator.payload, that differ from the plant's on "
        "purpose: no warning",
    )  # fmt: skip
    system = p.add_mutually_exclusive_group()
    system.add_argument("--ssp", type=Path, metavar="FILE.ssp", help="the system with its FMUs, made by ps-fmu ssp")
    system.add_argument(
        "--system", type=Path, metavar="FILE.ssd",
        help="another system than that of the scenario; FMUs that build/fmus has not are found by their source",
    )  # fmt: skip
    p.add_argument("--output", type=Path, metavar="DIR", help="folder of the results (results/SCENARIO)")
    p.add_argument("--scheme", choices=SCHEMES, default=SCHEMES[0], help="order of exchange (%(default)s)")
    p.add_argument("--storage-step", type=float, metavar="S", help="seconds between stored rows")
    p.add_argument(
        "--requirements", type=Path, metavar="F.toml", help="pointing requirements; exit code 1 if one is not met"
    )
    return p


def read_options(scenario: Scenario, arguments: argparse.Namespace) -> RunOptions:
    """Checked options, with an output folder that can be written.  Raises OptionError."""
    duration, step, output = arguments.duration, arguments.step, arguments.output
    return RunOptions(
        scenario=scenario,
        system=arguments.ssp or arguments.system or ROOT / "system" / scenario.system,
        output=output if output is not None else Path("results", scenario.name),
        duration_s=duration if duration is not None else scenario.duration_s,
        step_s=step if step is not None else scenario.step_s,
        seed=arguments.seed,
        parameters=tuple(arguments.parameters),
        apart=tuple(arguments.apart),
        scheme=arguments.scheme,
        storage_step_s=arguments.storage_step,
        requirements=arguments.requirements,
        fmus=None if arguments.ssp else ROOT / "build" / "fmus",
        progress=True,
    ).claim_output()


def main(argv: Sequence[str] | None = None) -> int:
    """Run the scenario that the arguments name; returns the exit code."""
    found = find_scenarios(scenarios, figures)
    command_line = make_parser(found)
    with ExitStack() as stack:
        try:
            arguments = command_line.parse_args(argv)
            options = read_options(found[arguments.scenario], arguments)
            stack.enter_context(hold_folder(options.output))
        except OptionError as error:
            command_line.error(str(error))
        try:
            if options.fmus is not None:
                ensure_built(options.fmus, ROOT)
            options.scenario.run(options)
        except KeyboardInterrupt:
            return report_end("interrupted", options.output, 130)
        except OptionError as error:  # one that needs the system to be seen, such as a path that takes longer
            command_line.error(str(error))
        except (BuildError, CosimError, OSError, ValueError) as error:
            return report_end(reason(error), options.output, 1)
    return 0


def report_end(why: str, output: Path, code: int) -> int:
    """Say why a run ended early and where its results are; returns the exit code."""
    results = output / RESULTS
    kept = f"results so far: {results}" if results.is_file() else "nothing was stored"
    print(f"run.py: {why}\nrun.py: {kept}", file=sys.stderr)
    return code


if __name__ == "__main__":
    sys.exit(run_command(main))
