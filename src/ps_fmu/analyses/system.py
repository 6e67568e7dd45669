"""The system that an analysis runs, with FMUs that are up to date with their sources."""

from __future__ import annotations

from pathlib import Path

from ..cosim import System, read_system
from ..cosim.description import index_variables, read_descriptions, read_start
from ..product.files import find_product
from ..runs.built_fmus import provide_fmus
from ..runs.options import OptionError
from .table import AnalysisOptions


def check_sources(system: Path) -> None:
    """Check, before anything is written, that FMUs can be built and the system can be read.

    Raises
    ------
    OptionError: there is no system description ``system``; the message says where the product's are.
    FileNotFoundError: the FMUs' sources are not there, since only the package's modules are.
    """
    product = find_product()
    if not system.exists():
        raise OptionError(f"--system: there is no system description {system}; those of ps_fmu are in {product.system}")


def load_built_system(options: AnalysisOptions) -> System:
    """Read the system of the options; builds its FMUs first if they are missing or older than their sources.

    Raises BuildError, CosimError.
    """
    provide_fmus(options.fmus, options.system)
    return read_system(options.system, options.fmus)


def load_default_system(options: AnalysisOptions, name: str) -> System:
    """As :func:`load_built_system`, for an analysis whose closed form is that of the product's system ``name`` alone.

    Raises :class:`OptionError`, too: a component, a start value or a connection of the system is another one.
    """
    system, default = load_built_system(options), read_system(find_product().system / name, options.fmus)
    found, expected = _list_start_values(system), _list_start_values(default)
    changed = [f"{key} = {found.get(key)}, there {value}" for key, value in expected.items() if found.get(key) != value]
    wires, wanted = ({f"{each.source} to {each.target}" for each in s.connections} for s in (system, default))
    changed += [f"the connection {each}" for each in sorted(wires ^ wanted)]
    if changed:
        more = f", and {len(changed) - 1} more" if changed[1:] else ""
        raise OptionError(
            f"--system: {options.system} is not as {name} of ps_fmu: {changed[0]}{more}: the closed form that the FMUs "
            "are compared with is of that system"
        )
    return system


def _list_start_values(system: System) -> dict[str, object]:
    """Values of all parameters by ``component.parameter``."""
    return {
        f"{component.name}.{name}": component.parameters[name].value
        if name in component.parameters
        else read_start(variable)
        for component, description in zip(system.components, read_descriptions(system).values(), strict=True)
        for name, variable in index_variables(description).items()
        if variable.causality == "parameter"
    }
