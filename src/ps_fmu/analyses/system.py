"""The system that an analysis runs, with FMUs that are up to date with their sources."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from ..cosim import System, UsageError, Value, read_parameters, read_system
from ..cosim.description import read_descriptions
from ..cosim.replacing import replace_components
from ..cosim.structure import Parameter
from ..product.files import find_product
from ..runs.built_fmus import provide_fmus
from ..runs.options import OptionError
from ..runs.setup import read_instrument_values
from ..runs.system import NOISE, RECORDING_PATH, RunSystem
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


def load_built_system(options: AnalysisOptions, system: Path | None = None) -> System:
    """Read the system of the options, or another one; builds its FMUs first if they are missing or outdated.

    The FMUs of the options take the places of components.  Raises BuildError, CosimError.
    """
    provide_fmus(options.fmus, system or options.system)
    return replace_components(read_system(system or options.system, options.fmus), options.replace)


def load_own_systems(options: AnalysisOptions, *others: Path) -> list[System]:
    """The system of the options, and others, with the values of their instrument, files and recorded disturbance.

    Values of components that a system does not have are left out of it.  Raises BuildError, and CosimError for a value
    of a component, parameter or unit that none of the systems has.
    """
    systems = [load_built_system(options), *(load_built_system(options, path) for path in others)]
    given: dict[str, Parameter] = {}
    for path in options.parameters:
        given |= read_parameters(path).entries()
    if options.disturbance is not None:
        own: dict[str, Value] = {NOISE: False, RECORDING_PATH: str(options.disturbance.absolute())}
        given = {name: Parameter(value, None, "--disturbance") for name, value in own.items()} | given
    names = {component.name for system in systems for component in system.components}
    for name, entry in given.items():
        if name.partition(".")[0] not in names:
            raise UsageError(f"{name} ({entry.origin}): there is no such component")
    return [_set_values(system, _describe(options, system) | given) for system in systems]


def _describe(options: AnalysisOptions, system: System) -> dict[str, Parameter]:
    if options.instrument is None:
        return {}
    return read_instrument_values(options.instrument, system, read_descriptions(system))[0]


def _set_values(system: System, given: Mapping[str, Parameter]) -> System:
    names = {component.name for component in system.components}
    own = {name: entry for name, entry in given.items() if name.partition(".")[0] in names}
    changed = system.with_parameters(own)
    checked = RunSystem(changed, read_descriptions(changed), own)
    for name, port in ((name, changed.find_port(name)) for name in own):
        if port.variable in changed.component(port.component).parameters:
            checked.get_start(name)
    return changed
