"""Commands about one system, ``list``, ``ssp``, ``parameters``; and the options by which all commands name a system."""

from __future__ import annotations

import argparse
import json
import re
import sys
import textwrap
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .product.files import find_file, find_product
from .runs.built_fmus import choose_fmus, provide_fmus
from .terminal import read_output, reason

if TYPE_CHECKING:
    from fmpy.model_description import ModelDescription

    from .cosim import System
    from .runs.scenario import Need

DEFAULT_SYSTEM = "SystemStructure.ssd"
TEMPLATES = {"isolator": "isolator", "sensor": "sensors", "controller": "pointing", "disturbance": "disturbance"}
"""What ``ps-fmu new`` writes, and the components whose places it takes."""
RUNS = {
    "sensor": "isolation --system InertialSensors.ssd",
    "controller": "isolation --system LineOfSight.ssd",
}
WIDTH = 100  # characters of a line of the list
GAP = 2  # characters between its columns
NUMBER = re.compile(r"(?<=_)\d+(?=\.)")
"""Of a thing that is one of several: ``fine_leg_1.stiffness``."""
LONGEST = (44, 5, 11, 11)  # characters of its columns: name, use, start, unit; longer texts have a line of their own
OPTIONS: Mapping[str, dict[str, Any]] = {
    "system": {
        "type": Path, "metavar": "FILE.ssd",
        "help": "system description: yours, or one of ps_fmu by its name, as ps-fmu run --help lists them",
    },
    "instrument": {
        "type": Path, "metavar": "F.toml",
        "help": "your payload, mechanism and bus: all FMUs start with its values; --parameters win",
    },
    "parameters": {
        "type": Path, "nargs": "+", "action": "extend", "default": [], "metavar": "F.ssv",
        "help": "files with start values by component.parameter: yours, or those of ps_fmu by name; later ones win",
    },
    "replace": {
        "action": "append", "default": [], "metavar": "COMPONENT=F.fmu",
        "help": "take this FMU in place of a component, such as isolator=my.fmu: variables of the same names take over "
        "its connections and values; may be repeated",
    },
    "fmus": {
        "type": Path, "metavar": "DIR",
        "help": "take FMUs from this folder by their file names; those of ps_fmu are found, and built, without it",
    },
}  # fmt: skip
"""How all commands name a system."""


def add_system_options(group: argparse._ActionsContainer, *names: str, default: str = "", **changes: str) -> None:
    """Add some of :data:`OPTIONS`; ``default``: of the system; ``changes``: names in the namespace, by option."""
    for name in names:
        settings = dict(OPTIONS[name])
        if name == "system" and default:
            settings["help"] += f" (default: {default})"
        if name in changes:
            settings["dest"] = changes[name]
        group.add_argument(f"--{name}", **settings)


def find_system(options: argparse.Namespace, default: str = DEFAULT_SYSTEM) -> tuple[Path, Path | None]:
    """The system of parsed options, and the folder that has its FMUs, built if they are ps_fmu's.

    Raises BuildError, CosimError, OSError.
    """
    system = find_product().system / default if options.system is None else find_file(options.system)
    fmus = choose_fmus(system, options.fmus)
    if options.fmus is None:
        provide_fmus(fmus, system)
    return system, fmus


def read_chosen(options: argparse.Namespace, *, lenient: bool = False) -> System:
    """The system of parsed options, with other FMUs and start values; ``lenient``: any, as ``ps-fmu run`` takes it.

    Raises OptionError, BuildError, CosimError, OSError.
    """
    from .cosim import read_parameters, read_system
    from .cosim.description import read_descriptions
    from .cosim.replacing import replace_components
    from .cosim.ssp.reading import read_any_system
    from .runs.options import read_replacements
    from .runs.setup import read_instrument_values

    replacements = read_replacements(options.replace)
    system = (read_any_system if lenient else read_system)(*find_system(options))
    system = replace_components(system, replacements)
    if options.instrument is not None:
        instrument = find_file(options.instrument)
        system = system.with_parameters(read_instrument_values(instrument, system, read_descriptions(system))[0])
    for path in map(find_file, options.parameters):
        system = system.with_parameters(read_parameters(path))
    return system


def add_parsers(commands: argparse._SubParsersAction[Any]) -> None:
    """Add the subcommands."""
    _add_list(commands)
    _add_ssp(commands)
    _add_parameters(commands)
    _add_new(commands)


# ---- new -----------------------------------------------------------------------------------------------------------


def _add_new(commands: argparse._SubParsersAction[Any]) -> None:
    command = commands.add_parser(
        "new",
        help="write a slave of one's own to begin with",
        description="Write the Python source of a small FMU that takes the place of a component of ps_fmu.  It builds, "
        "passes the checks and runs as it is.",
    )
    places = ", ".join(f"{kind}: for {component}" for kind, component in TEMPLATES.items())
    command.add_argument("kind", choices=tuple(TEMPLATES), help=f"what it is in place of ({places})")
    command.add_argument("file", type=read_output, metavar="FILE.py", help="new file; the FMU is called as the file")
    command.add_argument(
        "--instrument", type=Path, metavar="F.toml", help="geometry, stiffness and mass of an isolator: yours"
    )
    command.set_defaults(run=_new)


def _new(options: argparse.Namespace) -> int:
    from .files.plain import write_atomically
    from .interface.instrument_file import fill_isolator
    from .mechanism.kinematics import KinematicsError
    from .mechanism.quantities import ParameterError

    kind, file = options.kind, options.file
    problem = ""
    if file.suffix != ".py" or not (file.stem.isidentifier() and file.stem.isascii()):
        problem = "expected a name of letters, digits and underscores that ends with .py"
    elif file.exists():
        problem = "there is such a file: name another one"
    elif options.instrument is not None and kind != "isolator":
        problem = f"--instrument: the template {kind} has no number of an instrument: leave the option out"
    if problem:
        print(f"ps-fmu new: {file}: {problem}", file=sys.stderr)
        return 2
    model = "".join(word[:1].upper() + word[1:] for word in file.stem.split("_"))
    try:
        text = (find_product().system / "templates" / f"{kind}.py").read_text(encoding="utf-8")
        if options.instrument is not None:
            text = fill_isolator(text, find_file(options.instrument))
        write_atomically(file, text.replace(f"class {kind.capitalize()}(", f"class {model}("))
    except (ParameterError, KinematicsError) as error:
        print(f"ps-fmu new: {options.instrument}: {error}", file=sys.stderr)
        return 1
    except OSError as error:
        print(f"ps-fmu new: {reason(error)}", file=sys.stderr)
        return 1
    component, run = TEMPLATES[kind], RUNS.get(kind, "isolation")
    print(f"{file}\nps-fmu build {file}\nps-fmu run {run} --replace {component}={model}.fmu")
    return 0


# ---- ssp -----------------------------------------------------------------------------------------------------------


def _add_ssp(commands: argparse._SubParsersAction[Any]) -> None:
    ssp = commands.add_parser(
        "ssp",
        help="write the system as one .ssp file",
        description="Write wiring, FMUs and start values into one SSP 1.0 archive for other simulators.",
    )
    ssp.add_argument("--output", type=read_output, required=True, metavar="FILE.ssp")
    add_system_options(ssp, *OPTIONS, default=DEFAULT_SYSTEM)
    ssp.set_defaults(run=_ssp)


def _ssp(options: argparse.Namespace) -> int:
    from .cosim import CosimError, write_ssp
    from .runs.options import OptionError
    from .slavekit.pack.errors import BuildError

    try:
        system = read_chosen(options)
        for remark in (*system.remarks, *write_ssp(system, options.output)):
            print(f"ps-fmu ssp: {remark}", file=sys.stderr)
        print(f"{options.output}  {options.output.stat().st_size / 1e3:.0f} kB")
    except OptionError as error:
        print(f"ps-fmu ssp: {error}", file=sys.stderr)
        return 2
    except (BuildError, CosimError, OSError) as error:
        print(f"ps-fmu ssp: {reason(error)}", file=sys.stderr)
        return 1
    return 0


# ---- parameters ----------------------------------------------------------------------------------------------------


def _add_parameters(commands: argparse._SubParsersAction[Any]) -> None:
    command = commands.add_parser(
        "parameters",
        help="write the start values of all FMUs for one's own instrument",
        description="Read an instrument from a TOML file in the form of paper.toml, and write the start values of all "
        'FMUs of a system for --parameters.  With base = "paper" a file gives only what differs.  See '
        "system/parameters/README.md.  ps-fmu list shows the parameters that there are.",
    )
    command.add_argument("instrument", type=Path, metavar="INSTRUMENT.toml")
    command.add_argument("--output", type=read_output, required=True, metavar="FILE.ssv")
    command.add_argument(
        "--picture", type=_read_picture, metavar="FILE.svg",
        help="draw the mechanism: legs, joints, frames, the payload's centre of mass (.svg, .png, .pdf)",
    )  # fmt: skip
    command.add_argument("--bus", metavar="NAME", help="which [bus.NAME] (default: the file's own [bus], or else OSM)")
    add_system_options(command, "system", "fmus", default=DEFAULT_SYSTEM)
    command.add_argument("--all", action="store_true", help="write also what the FMUs start with anyway")
    command.set_defaults(run=_parameters)


def _read_picture(text: str) -> Path:
    path = read_output(text)
    if path.suffix not in (".svg", ".png", ".pdf"):
        raise argparse.ArgumentTypeError(f"expected a file that ends in .svg, .png or .pdf, got {text}")
    return path


def _parameters(options: argparse.Namespace) -> int:
    from .cosim.errors import CosimError
    from .interface.instrument_file import write_start_values
    from .mechanism.quantities import ParameterError
    from .slavekit.pack.errors import BuildError

    try:
        instrument, system = find_file(options.instrument), find_system(options)
        lines = write_start_values(
            instrument, options.output, *system, options.bus, everything=options.all, picture=options.picture
        )
        print(*lines, sep="\n")
    except ParameterError as error:
        print(f"ps-fmu parameters: {options.instrument}: {error}", file=sys.stderr)
        return 1
    except (BuildError, CosimError, OSError) as error:
        print(f"ps-fmu parameters: {reason(error)}", file=sys.stderr)
        return 1
    return 0


# ---- list ----------------------------------------------------------------------------------------------------------


def _add_list(commands: argparse._SubParsersAction[Any]) -> None:
    command = commands.add_parser(
        "list",
        help="list inputs, outputs and parameters of a system, an FMU or a scenario",
        description="List the inputs, outputs and parameters of a system or FMU, with start value, unit and meaning.  "
        "Of a scenario, list those of its system, and which of them the scenario sets and reads: an FMU in place of a "
        "component must have these.",
    )
    command.add_argument(
        "what", metavar="SYSTEM|FMU|SCENARIO", nargs="?", default="isolation",
        help=".ssd, .ssp, .xml or .fmu: yours, or one of ps_fmu by its name; or a scenario (default: isolation)",
    )  # fmt: skip
    command.add_argument(
        "patterns", metavar="PATTERN", nargs="*", help="list these alone, such as 'plant.payload*' or '*mass*'"
    )
    command.add_argument("--needed", action="store_true", help="list only what the scenario sets and reads")
    command.add_argument("--json", action="store_true", help="write all that is known of each variable as JSON")
    add_system_options(command, *OPTIONS, default="that of the scenario")
    command.set_defaults(run=_list)


def _list(options: argparse.Namespace) -> int:
    from .cosim.errors import CosimError
    from .runs.options import OptionError, choose_run
    from .slavekit.pack.errors import BuildError

    try:
        scenario, options.system = choose_run(options.what, options.system)
        needs = {need.name: need for need in scenario.find_needs()}
        system = read_chosen(options, lenient=True)
        rows = _choose(list(_list_variables(system, needs)), options)
    except OptionError as error:
        print(f"ps-fmu list: {error}", file=sys.stderr)
        return 2
    except (BuildError, CosimError, OSError) as error:
        print(f"ps-fmu list: {reason(error)}", file=sys.stderr)
        return 1
    for remark in system.remarks:
        print(f"ps-fmu list: {remark}", file=sys.stderr)
    print(json.dumps(rows, indent=1) if options.json else "\n".join(_format_rows(rows)))
    return 0


def _list_variables(system: System, needs: Mapping[str, Need]) -> Iterator[dict[str, Any]]:
    """What is known of each input, output and parameter of a system; start values are those of the system."""
    from .cosim.description import get_unit, read_descriptions, read_start

    feeding = {str(wire.target): str(wire.source) for wire in system.connections}
    descriptions: Mapping[str, ModelDescription] = read_descriptions(system, lenient=True)
    for component in system.components:
        for causality in ("input", "output", "parameter"):
            for variable in descriptions[component.name].modelVariables:
                if variable.causality != causality:
                    continue
                name = f"{component.name}.{variable.name}"
                entry = component.parameters.get(variable.name)
                stated = None if variable.start is None else read_start(variable)
                yield {
                    "name": name,
                    "component": component.name,
                    "fmu": component.source.name,
                    "causality": causality,
                    "type": variable.type,
                    "start": stated if entry is None else entry.value,
                    "unit": get_unit(variable) or ("1" if variable.type == "Real" else None),
                    "min": variable.min,
                    "max": variable.max,
                    "description": variable.description or "",
                    "connected_to": feeding.get(name),
                    "scenario": needs[name].use if name in needs else None,
                }


def _choose(rows: list[dict[str, Any]], options: argparse.Namespace) -> list[dict[str, Any]]:
    """Those that a pattern matches.  Raises UsageError for a pattern that matches none."""
    from .cosim.recording.thinner import select_names

    kept = set(select_names([row["name"] for row in rows], options.patterns, what="variable"))
    return [row for row in rows if row["name"] in kept and (row["scenario"] or not options.needed)]


def _format_rows(rows: list[dict[str, Any]]) -> Iterator[str]:
    """A table of at most :data:`WIDTH` characters for the inputs, outputs and parameters of each component.

    Components of a vector are one line, with a name that is a pattern, too: ``plant.los.[xy]``.  So are numbered things
    that are alike: ``plant.fine_leg_{1..3}.stiffness``.
    """
    sections: dict[str, dict[tuple[str, ...], str]] = {}  # ends of names by all that components of a vector share
    for row in rows:
        name, end = row["name"][:-1], row["name"][-1]
        vector = name[-1] in "._"
        start, source, about = row["start"], row["connected_to"] or "", row["description"]
        shown = f"{start:.6g}" if type(start) is float else str(start)
        if source:
            about = f"from {source.removesuffix(end) + '*' if vector else source}. {about}"
        if vector:
            about = about.removesuffix(f", {end}").removesuffix(f" ({end})")
        unset = source or start is None or row["causality"] == "output"
        use, unit = row["scenario"] or "", row["unit"] or ""
        common = name if vector else row["name"], use, "" if unset else shown, unit, about
        cells = sections.setdefault(f"{row['component']} ({row['fmu']}), {row['causality']}s", {})
        cells[common] = cells.get(common, "") + (end if vector else "")
    for title, cells in sections.items():
        lines = [(f"{name}[{ends}]" if ends[1:] else name + ends, *rest) for (name, *rest), ends in cells.items()]
        yield from ("", title, *_align(_join_numbered(lines)))


def _join_numbered(lines: list[tuple[str, ...]]) -> list[tuple[str, ...]]:
    """One line for those that differ in a number of the name alone, if the numbers follow one another."""
    alike: dict[tuple[str, ...], list[tuple[str, ...]]] = {}
    for name, *rest in lines:
        parts = NUMBER.split(name)
        alike.setdefault((*parts, *rest) if len(parts) == 2 else (name, *rest), []).append((name, *rest))
    joined = []
    for members in alike.values():
        numbers = [int(found[0]) for name, *_ in members if (found := NUMBER.findall(name))]
        if len(members) > 1 and numbers == list(range(numbers[0], numbers[-1] + 1)):
            name, *rest = members[0]
            joined.append((NUMBER.sub(f"{{{numbers[0]}..{numbers[-1]}}}", name), *rest))
        else:
            joined += members
    return joined


def _align(lines: list[tuple[str, ...]]) -> Iterator[str]:
    """Columns side by side; the last one has what is left of :data:`WIDTH`, and takes several lines."""
    widths = [min(max(len(line[k]) for line in lines), limit) for k, limit in enumerate(LONGEST)]
    left = WIDTH - sum(width + GAP for width in widths if width)
    for *texts, about in lines:
        pairs = zip(texts, widths, strict=True)
        start = "".join(text.ljust(width) + " " * GAP for text, width in pairs if width)
        if len(start) > WIDTH - left:
            yield start.rstrip()
            start = ""
        first, *others = textwrap.wrap(about, left) or [""]
        yield f"{start:{WIDTH - left}}{first}".rstrip()
        yield from (" " * (WIDTH - left) + text for text in others)
